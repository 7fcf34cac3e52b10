"""Forecasting: what is observed, the ways to forecast (contract: `forecasting.base`), the files of forecasts."""
