"""
Driving torque against swing
============================

Each point is one of thousands of four-bars. The figure shows the peak of the torque that
drives the crank at 1 rad/s, and the swing of the rocker. For the marked designs, no other
design is better in both.
"""

import matplotlib.pyplot as plt

import spherekit as sk

found = sk.sweep(
    "four_bar",
    {
        "links.1.arc": "45:75",
        "links.2.arc": "15:30",
        "links.3.arc": "50:90",
        "links.4.arc": "30:60",
    },
    [
        "peak=max(abs(torque))",
        "swing=swing(theta_41)",
        "least=min(transmission_angle_43)",
    ],
    where=["least > 30", "closes > 0.999"],
    designs=4096,
    samples=181,
)
figure, panel = plt.subplots(layout="constrained")
for mode, designs in found.frame().groupby("mode"):
    (cloud,) = panel.plot(designs["swing"], designs["peak"], ".", alpha=0.2, mew=0)
    designs = designs.sort_values("swing", ascending=False)
    best = designs[designs["peak"].cummin() == designs["peak"]]
    line = {"marker": "o", "markersize": 3, "color": cloud.get_color()}
    panel.plot(best["swing"], best["peak"], label=f"mode {mode}", **line)
panel.set(xlabel="swing of the rocker, deg", ylabel="peak of the torque, N m")
panel.legend()
figure
