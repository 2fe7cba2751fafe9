"""Plain NumPy transcriptions of the control laws, from the papers' equations and the headers: the oracle of
the tests.

liu2018: Liu, Li, Deng, "Torque Ripple Minimization of PMSM Based on Robust ILC Via Adaptive Sliding Mode
Control".
mandra2019: Mandra, Galkowski, Rogers, Rauh, Aschemann, "Performance-Enhanced Robust Iterative Learning
Control With Experimental Application to PMSM Position Tracking".
"""
