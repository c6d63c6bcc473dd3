"""Values that a user fixes: how they are asked for, and whether the record agrees with them."""
