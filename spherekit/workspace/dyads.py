"""Outputs whose mechanism falls into dyads when they are held, in closed form."""

from typing import final

import numpy as np

from spherekit.guidance.mid_plane_architecture import axis_in
from spherekit.model.geometry import COLLINEAR
from spherekit.output.dyads import Signs
from spherekit.output.inverse import InverseKinematics
from spherekit.sphere.rotation import Floats
from spherekit.workspace.kinematics import ClosedKinematics
from spherekit.workspace.rows import Rows, Span


@final
class DyadKinematics(ClosedKinematics):
    """An output whose mechanism falls into dyads when it is held."""

    solved_by = "dyads"

    def __init__(self, kinematics: InverseKinematics) -> None:
        wrist = kinematics.wrist
        super().__init__(kinematics.own, wrist.output, wrist.points)
        self.kinematics, self.modes = kinematics, kinematics.modes
        self._own = {pair: self._same_axis(pair) for pair in wrist.pairs}
        self.legs = tuple(
            "leg of "
            + ", ".join(
                self.name_of(self._own.get(pair, pair))
                for pair in (stand.near, stand.middle, stand.far)
            )
            for stand in kinematics.stands
        )

    def _same_axis(self, made: int) -> int:
        """Return the mechanism's own pair with the axis of one made for the output."""
        mechanism, joints = self.kinematics.mechanism, self.kinematics.solver.joints
        link = self.kinematics.wrist.link
        if link in mechanism.ends[made]:
            axis = axis_in(mechanism, joints, made, link)
            for pair, ends in enumerate(self.mechanism.ends):
                if link in ends:
                    gap = axis_in(mechanism, joints, pair, link) - axis
                    if np.linalg.norm(gap) < COLLINEAR:
                        return pair
        return made

    @property
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach: the outer axes of every dyad."""
        renamed = self._own
        return tuple(
            Span(renamed.get(s.near, s.near), renamed.get(s.far, s.far), s.cones, True)
            for s in self.kinematics.stands
        )

    def at(self, poses: Floats, signs: Signs) -> Rows:
        """Return one mode at poses."""
        return self.kinematics.posed(poses, signs)
