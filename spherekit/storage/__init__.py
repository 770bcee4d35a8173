"""Writing files completely or not at all, locks on files, and JSON values."""
