"""Certified statements: assembly modes and singular configurations proven with balls."""
