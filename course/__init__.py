"""The course's own parts: its data, its checks against the truth, its exercises. Used by helpers.py only."""
