"""What is felt equally strong: laws of strength, and what a person's matches tell of them."""
