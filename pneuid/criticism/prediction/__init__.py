"""What a model predicts of runs, and what noise alone would leave of that."""
