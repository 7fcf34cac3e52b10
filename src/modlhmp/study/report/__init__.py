"""The report: one page per run that reads as a paper, with every exhibit in its place."""
