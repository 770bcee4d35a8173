"""What an analysis may read: a block of samples, limited to what it declared."""
