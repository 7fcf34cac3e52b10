"""Maps that are updated: told of people bit by bit, in any order, they are what one building of all would have made.

Counted maps (`counted`: CLiFF, STeF) hold whole numbers by hour and cell; kept maps (`kept`: episodes, snippets, ways
out) hold the rows of the tracks themselves. Forgetting is a matter of reading: what is held does not change with time.
"""
