"""The explorer: one page per run to look at its maps, and where that may be, at its people, in a browser."""
