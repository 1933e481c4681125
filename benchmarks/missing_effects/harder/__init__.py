"""Harder truths, whose sizes and instances each seed draws: `--harder`.

Several powers of one signal, rates of states, coefficients that vary with the flight condition,
actuators with two defects, separated flow next to a term, late and curved sensors, a mass that
steps, and an effect in the motion with one in a sensor. The default library lacks some of them:
then the right answer names no cause.
"""
