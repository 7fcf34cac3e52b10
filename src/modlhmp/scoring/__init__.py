"""Scoring: forecasts against what people really did."""
