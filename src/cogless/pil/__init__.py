"""Processor in the loop: the exported controller on an emulated Cortex-M4F, closed with the native plant."""
