# Figures of example forecasts, named after the paper's labels.
#
# INPUTS   clean test tracks, forecasts, floor plans
# OUTPUTS  paper_figures/{run}/<label>.{pdf,png,csv}
# STEPS    FORECAST_FIGURES collects them


FORECAST_FIGURES = []
