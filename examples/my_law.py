"""A speed law of one's own: a PI, and a sinusoid of one mechanical order that learns to cancel ripple."""

from math import cos, sin


class CancelOrder:
    map_law = 130  # this law's number in stored maps: one of 128 to 255

    def __init__(self, kp, ki, order, rate, lead):
        """kp [A s/rad], ki [A/rad], order of the revolution, rate [A/rad], lead [rad]."""
        self.kp, self.ki, self.order, self.rate, self.lead = kp, ki, order, rate, lead
        self.integral = self.a = self.b = 0.0  # A
        self.i_q_learned = 0.0  # A: the signal term_learned

    def learned_map(self):
        """What is learned, for the results folder: cosine and sine [A] of each order."""
        return {self.order: (self.b, self.a)}

    def load_map(self, learned):
        """Begins with what this law or any other has learned, in the form of learned_map()."""
        self.b, self.a = learned[self.order]

    def step(self, inputs):
        """Called once per speed-loop period; returns i_q_ref [A], or (i_d_ref, i_q_ref)."""
        error = inputs.omega_ref - inputs.omega_m
        angle = self.order * inputs.theta_m
        self.integral += self.ki * inputs.ts * error
        if inputs.learn:
            self.a += self.rate * inputs.ts * error * sin(angle - self.lead)
            self.b += self.rate * inputs.ts * error * cos(angle - self.lead)
        self.i_q_learned = self.a * sin(angle) + self.b * cos(angle)
        return self.kp * error + self.integral + self.i_q_learned
