"""What `tactuator identify` says of records that are spoilt."""
