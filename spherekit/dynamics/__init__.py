"""Dynamics of single-DOF mechanisms by Eksergian's equation, in both directions."""
