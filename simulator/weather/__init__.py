"""Fog, rain, wet roads and night."""
