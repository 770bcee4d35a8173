"""The analysis `inverse_kinematics`: lists of poses, tables, and what fills them."""

from .analysis import InverseKinematicsAnalysis as InverseKinematicsAnalysis
