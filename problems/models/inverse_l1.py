"""The inverse model of the L1 prototype with its filters (Dressler 2012, Fig. 3.2)."""

import gtmodel as gt


class InverseL1(gt.robots.InverseModel):
    """Motor forces [N] that move the carts of the L1 along filtered references [m]."""

    robot = gt.part(gt.robots.gantry_tau("l1_tape", inertia="model_2", velocity_scale=0.1))
