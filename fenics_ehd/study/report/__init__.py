"""The report of a study: one HTML page, the same as Markdown, figures as SVG and PNG."""

from fenics_ehd.study.report.write import write_report

__all__ = ["write_report"]
