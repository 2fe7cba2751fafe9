"""Plain NumPy transcriptions of the control laws, from the papers' equations and the headers: the oracle of
the tests.

liu2018: Liu, Li, Deng, "Torque Ripple Minimization of PMSM Based on Robust ILC Via Adaptive Sliding Mode
Control".
"""
