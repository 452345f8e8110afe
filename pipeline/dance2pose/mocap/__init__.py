"""Motion capture files: reading them, and their joints on one skeleton and one body."""
