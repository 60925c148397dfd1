"""The part of the report about a sequence of frames."""
import pathlib

import plots


def add_sequence(document, measured):
    """Adds the part. `measured`: the results that ktgp_evaluate_bag writes."""
    sequence = measured["sequence"]
    frames = sequence["frames"][1:]  # the first frame has no reference
    document.heading(f"Sequence {pathlib.Path(measured['bag']).name}, {measured['topic']}")
    if not frames:
        document.text("It has fewer than two images.")
        return
    times = [f["time"] for f in frames]
    found = sum(f["status"] == "ok" for f in frames)
    document.text(
        f"{len(frames)} frames, each matched to the one before; a homography was found for {found}."
        " Inlier ratio: final matches over matches that passed the ratio filter.")
    document.picture("sequence_matches.svg", "Matches after each stage", plots.lines(
        times, {name: [f["matches"][i] for f in frames]
                for i, name in enumerate(("knn", "tf", "gms", "prosac"))}, "s", "matches"))
    document.picture("sequence_inliers.svg", "Inlier ratio", plots.lines(
        times, {"inlier ratio": [100 * f["inlier_ratio"] for f in frames]}, "s", "%"))
    document.picture("sequence_ms.svg", "Time of a frame: features and all stages", plots.lines(
        times, {"ms": [f["ms"] for f in frames]}, "s", "ms"))
    survival = sequence["survival"][:60]
    document.picture("sequence_survival.svg", "Keypoints matched without a gap over k frames, of "
                     "those matched to the next frame", plots.lines(
                         list(range(1, len(survival) + 1)),
                         {"survival": [100 * s for s in survival]}, "k, frames", "%"))
    known = [f for f in frames if f.get("drift") is not None]
    if not known:
        document.text("The bag has no true homographies, so there is no drift to show.")
        return
    window = measured["drift_window"]
    over = f"over {window} frames, then restarted" if window else "over the whole sequence"
    document.picture("sequence_error.svg", "Corner error of each frame's homography, px",
                     plots.lines([f["time"] for f in known],
                                 {"corner error": [f["corner_error"] for f in known]}, "s", "px"))
    document.picture("sequence_drift.svg", f"Drift: corner error of the homographies multiplied "
                     f"{over}, px",
                     plots.lines([f["time"] for f in known],
                                 {"drift": [f["drift"] for f in known]}, "s", "px"))
