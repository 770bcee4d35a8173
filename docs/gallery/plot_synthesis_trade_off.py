"""
Driving torque against swing
============================

Four-bars with the least peak of the driving torque for every swing of the rocker: the
Pareto front of each assembly mode, and behind it the designs that were looked at first.
"""

import matplotlib.pyplot as plt
import numpy as np

import spherekit as sk

found = sk.synthesize("../../examples/synthesis/trade_off.toml", designs=512, starts=1)
frame = found.frame()
sweep = found.synthesis.sweep.part(0)

figure, panel = plt.subplots(layout="constrained")
for mode, tone in {"+": "tab:blue", "-": "tab:orange"}.items():
    looked = (sweep["mode"] == mode) & (sweep["status"] == "OK")
    panel.plot(sweep["swing"][looked], sweep["peak"][looked], ".", color=tone, alpha=0.15)
    front = frame[frame["mode"] == mode]
    panel.plot(front["swing"], front["peak"], "o-", color=tone, label=f"mode {mode}")
panel.set(xlabel="swing of the rocker, deg", ylabel="peak of the torque, N m")
panel.set_ylim(0.0, 1.2 * np.max(frame["peak"]))
panel.legend()
figure
