"""Other people's forms of maps, tracks and forecasts, in and out."""
