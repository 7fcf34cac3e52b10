"""The study: what exists because of one paper and its experiment. It imports the library, never the other way round."""
