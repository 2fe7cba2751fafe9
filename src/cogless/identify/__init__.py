"""From a drive's own logs back to a motor: inertia, friction, cogging, ripple of K_t, the encoder's error."""
