"""The report of a study: one HTML page, the same as Markdown, figures as SVG and PNG."""
