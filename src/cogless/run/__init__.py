"""Study to engine to runs: one controller in one scenario, or thousands side by side."""
