"""Maps of dynamics and long-term human motion prediction.

Data flow one way: readers -> cleaning -> maps -> forecasting -> scoring -> paper.
"""

__version__ = "0.1.0"
