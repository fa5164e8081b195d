"""A laser tracker and an inertial unit on one body: the experiment of Cvitanic 2021, chapter 4, as a study."""
