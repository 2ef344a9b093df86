"""What the files of a run folder are called."""

RESULTS = "results.csv"
MANIFEST = "manifest.json"
FIGURE = "figure.png"
FIGURE_NUMBERS = "figure.csv"
REPORT = "report.html"
SUBGOALS = "subgoals.csv"
ANATOMY = "anatomy.json"

WRITTEN_WHOLE = (RESULTS, MANIFEST, FIGURE, FIGURE_NUMBERS, REPORT, SUBGOALS, ANATOMY)

POLICIES = "policies"  # folders
STAGES = "stages"
VIDEOS = "videos"
REPLAYS = "replays"
FAILURES = "failures"
CHECKPOINTS = "checkpoints"
TENSORBOARD = "tensorboard"
