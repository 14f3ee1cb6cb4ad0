"""What the scores are shown as: tables, figures, reliability of the confidence, spans of failures."""
