"""The report page of a drive."""
