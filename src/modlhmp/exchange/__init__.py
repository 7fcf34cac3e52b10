"""Other people's forms of maps (`maps`), tracks and forecasts, in and out."""
