"""From logs to a model with uncertainty: the audit of the data, rows, estimators, identification."""
