"""Forms of a transfer function, what is known of them beforehand, and the freedom that it leaves."""
