"""Reasons why claims of the report do not hold on our aircraft, for the default seed."""

REASONS: dict[str, str] = {
    "the order of F is kept": (
        "nearly so: lateral 1 has 0.69 with a limit of 0.7, of 8 terms. Likelihood multiplies "
        "the F of Cn's beta and of Cl's aileron and beta by 30 to 70, and that of CY's beta and "
        "Cn's rudder by 2 at most. High noise changes the order no more than that."
    ),
    "the bands hold the truth": (
        "a band counts the noise of the outputs and the estimated terms only. Without constant "
        "errors of the instruments the whole CY, Cl and Cn of lateral 1 err by 0.8, 0.6 and 0.7 "
        "% of their ranges in place of 8.9, 1.8 and 1.8 %, and still only 17 to 37 % of the "
        "samples are inside: terms that keep the regression's values count as known, and so do "
        "the form of the polynomials and the measured u, w and q. The report expects bands that "
        "are too narrow for the same reasons (page 103)."
    ),
    "the leading terms survive high noise": (
        "all strong terms of CY and Cl do. In Cn the F of rudder falls more with noise than that "
        "of rhat, which then passes the 4 %; and aileron has an F of 17 in lateral 1, together "
        "with alpha phat and alpha^2 beta, and of 156 in lateral 2, whose regression takes fewer "
        "terms."
    ),
    "small amplitude improves Cm": (
        "measured by the range of its own record, which is 8 deg of alpha in place of 18, "
        "because our flight turns back before the hump (`python -m benchmarks.report_cases` "
        "shows why). On the angles that both cover the error is less than half of that of "
        "longitudinal 1, and the stabilator's derivative is twice as good."
    ),
    "two experiments combined beat each": (
        "the weights are wrong. In the regression of lateral 4 `alpha beta` misses the 4 % and "
        "is not estimated, so that the change of its slope over alpha counts as known: a "
        "deviation of 0.0006 per rad everywhere, against errors from -0.022 to 0.030. A joint "
        "fit of both records does as well as lateral 1 alone."
    ),
    "a longer coupled record improves Cm": (
        "static Cm and the stabilator's derivative make up for each other's errors, as the "
        "stabilator moves alpha all the time: the whole Cm errs by 2.9 % of its range in coupled "
        "1, and the static part at zero stabilator by 9.5 %. Constant errors of the instruments "
        "have their part in it (6.9 % without them), and still longitudinal 1 is no worse. The "
        "first 10 s of the same record do not start: their terms diverge."
    ),
    "case 1 predicts case 2": (
        "alpha is predicted well for 3 s (Theil 0.01). Then the flight crosses the hump of Cm, "
        "where it is unstable, and an error of 14 % of the range of Cm decides the further "
        "motion of all channels. Case 2 also reaches beta of -4 deg where case 1 ends at -2, "
        "and terms such as beta^3 and alpha^8 extrapolate badly. An initial state that is fitted "
        "to the first second does not help."
    ),
}
