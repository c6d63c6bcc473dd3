"""The experiment in a browser: a page for the subject, a page for the operator, one rig behind them."""
