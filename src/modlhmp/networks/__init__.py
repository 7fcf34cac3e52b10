"""The learned baselines: the paper's LSTM, Social LSTM, Trajectron++, TUTR and MID, and a neural map of our own.

One module per network (contract: `networks.network`), trained by one loop (`networks.training`) on one form of data
(`networks.data`), and forecasting like any other method (`networks.forecaster`). PyTorch is imported only in here.
"""
