"""Names of the files in a run folder."""

RESULTS = "results.csv"
MANIFEST = "manifest.json"
FIGURE = "figure.png"
FIGURE_NUMBERS = "figure.csv"
REPORT = "report.html"
SUBGOALS = "subgoals.csv"
ANATOMY = "anatomy.json"
MAPS = "maps.csv"
STARTS = "starts.csv"
FAILED_EPISODES = "failures.json"
VALUES = "values.json"

WRITTEN_WHOLE = (
    RESULTS,
    MANIFEST,
    FIGURE,
    FIGURE_NUMBERS,
    REPORT,
    SUBGOALS,
    ANATOMY,
    MAPS,
    STARTS,
    FAILED_EPISODES,
    VALUES,
)

POLICIES = "policies"  # folders
STAGES = "stages"
VIDEOS = "videos"
REPLAYS = "replays"
FAILURES = "failures"
CHECKPOINTS = "checkpoints"
TENSORBOARD = "tensorboard"
