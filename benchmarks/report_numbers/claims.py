"""Claims of the report about its method, and the numbers that decide each claim on our aircraft.

"Error of a coefficient" is one number: root mean square of the estimated minus the tables' value,
over a record's samples at the true angles; where records are compared, at zero sideslip on equal
steps of the angles of attack that all of them cover. Static coefficients (`Cm` without controls
and rates) and control derivatives are compared each on its own, as in the report's figures. "Final
F" is that of the likelihood; terms are without constants and biases. The report uses words such as
"close" or "good": the bounds are ours.
"""

from typing import NamedTuple


class Claim(NamedTuple):
    """One claim.

    Attributes:
        name: short name.
        section, page: place in the report.
        cases: required cases, names in `jaxid.aircraft.flight.report_cases`.
        statement: statement of the report, in our words.
        compared: computed numbers, and the condition under which the claim holds.
        printed: result on the report's own printed numbers, or a note that it rests on a figure.
    """

    name: str
    section: str
    page: int
    cases: tuple[str, ...]
    statement: str
    compared: str
    printed: str


FIGURE = "by a figure only"
SEPARATE = ("lateral 1", "longitudinal 1")

CLAIMS: tuple[Claim, ...] = (
    Claim(
        "F grows in the second stage",
        "6.2.3.3, point a",
        106,
        SEPARATE,
        "The final F-values are higher than those before: likelihood improves on the regression.",
        "F of each estimated term by regression and in the end; it holds if the median ratio is "
        "above 1 in every case. Also given: the number of terms that grew.",
        "Table 6.5: 7 of 8 and 8 of 9 terms grew. Of all cases 34 of 50, of lateral 4 only 2 of 9.",
    ),
    Claim(
        "the order of F is kept",
        "6.2.3.3, point b",
        106,
        (*SEPARATE, "lateral 2"),
        "The terms rank by final F nearly as by the regression's; with high noise the order "
        "changes considerably (6.3.1, page 119).",
        "Spearman's rank correlation of F by regression with final F over the estimated terms of "
        "a case; it holds if it is above 0.7 in the first two cases, and lower in lateral 2 than "
        "in lateral 1.",
        "Rank correlation 0.88, 0.75 and 0.68.",
    ),
    Claim(
        "both stages give F of one size",
        "6.2.3.3, point c",
        106,
        SEPARATE,
        "F by regression and F by likelihood at the same values are of the same order of "
        "magnitude.",
        "Their ratio for each estimated term; it holds if at least half of the ratios lie "
        "between 0.1 and 10 in every case.",
        "Table 6.5: 7 of 8 (the other is a doubtful exponent) and 5 of 9; the likelihood's is "
        "smaller in 13 of 17.",
    ),
    Claim(
        "the bands hold the truth",
        "6.2.3.3",
        106,
        SEPARATE,
        "Bands of two sigma about the estimated coefficients hold the true ones most of the time "
        "in the lateral case (page 115: Cm does not at its extremes, and control derivatives are "
        "biased).",
        "Share of samples with the true Cl, Cn, CY of lateral 1 inside two deviations, of the "
        "parameters, the misfit of the polynomials and the instruments (`Identification."
        "combined_bands`); it holds if each is above one half. Also given: the shares of CX, CZ, "
        "Cm in longitudinal 1, and those of bands of the parameters alone, which are the report's.",
        FIGURE,
    ),
    Claim(
        "the leading terms survive high noise",
        "6.3.1",
        117,
        ("lateral 1", "lateral 2"),
        "What the regression still finds with high noise are exactly the most important terms "
        "found with base noise.",
        "By equation, the terms of lateral 2 that pass the 4 % rule, among those of lateral 1 "
        "that do; it holds if all are. Beside it, the number of terms chosen.",
        "All 7 are among the 8; only alpha rhat in Cl is lost. 8 terms are chosen in place of 27.",
    ),
    Claim(
        "high noise lowers F",
        "6.3.1",
        119,
        ("lateral 1", "lateral 2"),
        "The final F-values are about ten times smaller than with base noise.",
        "Ratio of final F, lateral 1 to lateral 2, for the terms estimated in both; it holds if "
        "the median is between 3 and 30.",
        "The median of 7 is 2.8; Cn's beta and beta^3 grew.",
    ),
    Claim(
        "the leading terms survive gusts",
        "6.3.2",
        125,
        ("lateral 1", "lateral 3"),
        "beta in CY and in Cl, rudder and beta in Cn are again the most significant terms; five "
        "others are new.",
        "By equation, the term of largest F in lateral 1 (the two largest in Cn) and in lateral "
        "3; it holds if they are the same.",
        "So it is: Tables 6.3 and 6.9.",
    ),
    Claim(
        "small amplitude improves Cm",
        "6.4.1",
        130,
        ("longitudinal 1", "longitudinal 2"),
        "With half the stabilator the shape of Cm over alpha comes out much better, though "
        "biased, for the stabilator's own derivative is then badly determined.",
        "Error of Cm on the angles of attack of both, its mean taken off, which is the shape's; it "
        "holds if it is smaller in longitudinal 2 than in 1. Beside it, the whole error and the "
        "error of the stabilator's derivative.",
        "By Figure 6.19 only; the text says that case 1 fits badly but with less bias.",
    ),
    Claim(
        "two experiments combined beat each",
        "6.4.2",
        140,
        ("lateral 1", "lateral 4"),
        "The slope of Cn in beta over alpha, averaged with the inverse variances, is nearer to "
        "the truth than either estimate where both records have been.",
        "dCn/dbeta at beta = 0 on 50 equal steps of alpha over the range that both records "
        "cover, from each fit with its standard deviation, combined by Eq. 4.15; it holds if the "
        "combination's root mean square error is below both.",
        FIGURE + ", 6.22",
    ),
    Claim(
        "twelve parameters beat twenty-two",
        "6.4.3",
        148,
        ("lateral 1",),
        "With 22 parameters the outputs fit better, but the coefficients come out slightly "
        "worse: the rudder's derivative in Cn much better, Cn slightly; Cl the same; the "
        "aileron's in Cn slightly worse, the aileron's in Cl and CY much worse.",
        "Errors of Cl, Cn, CY and of the three control derivatives from the set of the 4 % rule, "
        "and from that set with all terms of F of 50 and more and the biases of ay, p, r; it "
        "holds if more of the six are larger in the second than in the first. Beside it, the "
        "final costs.",
        "Costs -18.543 and -19.801: the outputs do fit better. The coefficients by a figure only",
    ),
    Claim(
        "a longer coupled record improves Cm",
        "6.4.4",
        155,
        ("longitudinal 1", "longitudinal 2", "coupled 1"),
        "With 15 s and both planes excited all coefficients fit better than in the separate "
        "cases, Cm best of all its estimates.",
        "Error of Cm on the angles of attack of coupled 1, longitudinal 1 and 2; it holds if the "
        "first is the smallest. Also given: the errors of CZ, and of the slopes of CY, Cl and Cn "
        "in beta, and those of the separate cases.",
        FIGURE + ", 6.30",
    ),
    Claim(
        "case 1 predicts case 2",
        "6.5",
        161,
        ("coupled 1", "coupled 2"),
        "Parameters of coupled 1, unchanged, predict the outputs of coupled 2 more than "
        "satisfactorily if not as well as those of their own record, and its coefficients "
        "remarkably well.",
        "Theil's coefficient of each of the seven outputs in coupled 2, simulated from its own "
        "start with the parameters of coupled 1; it holds if all are below 0.25, the bound of "
        "`jaxid.diagnosis.statistics`. Also given: those of the fit to coupled 1, and errors of "
        "the static coefficients in both.",
        FIGURE + "s, 6.31 to 6.34",
    ),
    Claim(
        "the slope of Cn changes its sign",
        "3.3.1",
        40,
        ("rudder doublet at 15 deg", "rudder doublet at 25 deg"),
        "The linear models find the sign change of Cn's slope in beta between 15 and 25 deg.",
        "The regression's coefficient of beta in Cn at both angles and the tables' slope there; "
        "it holds if the signs agree at both.",
        "Positive at 15 deg, negative at 25 deg; the values are not printed.",
    ),
)
