"""Mechanism and study files in TOML: schema, reading, writing, the shipped library."""
