"""What the estimators promise, measured."""
