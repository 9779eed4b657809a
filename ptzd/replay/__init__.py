"""Drive the same core from a log, compare, report."""
