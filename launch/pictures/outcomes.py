"""The colours and signs of subgoals' outcomes, the same in all pictures."""

import hac_suite

COLOURS = {
    hac_suite.Outcome.ACHIEVED: "#1a7f37",
    hac_suite.Outcome.MISSED: "#c5221f",
    hac_suite.Outcome.CUT_SHORT: "#6b7280",
}
"""Dark enough for text on white."""

SIGNS = {
    hac_suite.Outcome.ACHIEVED: "✓",
    hac_suite.Outcome.MISSED: "✗",
    hac_suite.Outcome.CUT_SHORT: "–",
}
