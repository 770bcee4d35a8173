"""The published table of secondary poles of the spherical Stephenson mechanism."""

LECTURE_TABLE = [
    ["■", "x", "I", "x", "II", "x"],
    ["x", "■", "x", "I", "III", "III"],
    ["I", "x", "■", "x", "x", "II"],
    ["x", "I", "x", "■", "III", "III"],
    ["II", "III", "x", "III", "■", "x"],
    ["x", "III", "II", "III", "x", "■"],
]
"""Steps in which the poles are found, by link and link; primary poles are `x`.

Source: Di Gregorio 2019, lecture 2, case study 'Spherical Stephenson Mechanism'.
"""
