"""Drawing primitives on pictures, and matplotlib figures."""
