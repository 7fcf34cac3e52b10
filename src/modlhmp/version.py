"""The version: the one place; the package, its outputs and its pages take it from here."""

__version__ = "1.0.0"
