"""The F1 in five degrees of freedom (Dressler 2012, eqs. (4.25), (4.26)), with its printed geometry."""

import gtmodel as gt


class FiveDof(gt.Model):
    """Carts and rotary axes from the tool centre point and the angles q4 = -q5 and q6."""

    robot = gt.part(gt.robots.f1_five_dof())
