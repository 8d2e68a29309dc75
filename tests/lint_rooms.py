"""Former name of lint_house.py, until its last callers have changed."""

import sys

import lint_house

sys.exit(lint_house.main())
