"""Signals: filters and their other forms, noise that can be replayed, linear prediction, spectrograms."""
