"""The learned baselines: the paper's LSTM, Social LSTM, Trajectron++, TUTR and MID, and a neural map of our own.

One module a network (contract: `networks.network`), trained by one loop (`networks.training`) on one form of data
(`networks.data`), and forecasting like any other method (`networks.forecaster`). PyTorch is imported only in here.
"""

import os
from importlib import import_module

PUBLISHED = ("lstm", "social_lstm", "trajectronpp", "tutr", "mid")
KINDS = (*PUBLISHED, "neural_map")

# Read when PyTorch loads OpenMP: threads that wait by spinning stall each other when another process is busy.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def network_class(kind):
    """The class of a kind of network: `Network` of the module of that name."""
    return import_module(f"modlhmp.networks.{kind}").Network
