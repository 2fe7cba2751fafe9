"""Processor in the loop: the exported controller runs on an emulated Cortex-M4F, with the simulated plant."""
