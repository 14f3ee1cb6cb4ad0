"""Rendered roads and boards, seen by a real lens, with exactly known truth."""
