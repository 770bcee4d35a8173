"""What can be seen of a mechanism, described without any viewer or plotting library."""
