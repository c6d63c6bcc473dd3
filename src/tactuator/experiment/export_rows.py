from tactuator.experiment.export import cell, exported  # noqa: F401  (shim so that the tests' imports stay as they are)
