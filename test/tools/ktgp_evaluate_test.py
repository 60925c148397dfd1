"""Runs ktgp_evaluate as a program."""
import os
import random
import re
import shutil
import unittest

import cv2
import numpy as np
from tool_case import HEIGHT, WIDTH, ToolCase, picture, translation, window, write_pgm

SHIFTS = {2: (3, 4), 3: (-6, 8), 4: (9, -2), 5: (-12, -5), 6: (15, 10)}
KITTI = os.path.join(os.environ.get("KTGP_ORB_DATA", ""), "two_view/kitti_2")
CAMERA = "300 300 160 120"  # fx fy cx cy, px
DOGMAN = os.path.join(os.environ.get("KTGP_ORB_DATA", ""), "hard/dogman")


def auc(errors, threshold):
    """Area under the recall curve up to the threshold, over it: straight lines between the sorted errors."""
    x, y = [0.0], [0.0]
    for i, error in enumerate(e for e in errors if e < threshold):
        x.append(error)
        y.append((i + 1) / len(errors))
    x.append(threshold)
    y.append(y[-1])
    return sum((b - a) * (c + d) / 2 for a, b, c, d in zip(x, x[1:], y, y[1:])) / threshold


class KtgpEvaluate(ToolCase):
    def setUp(self):
        super().setUp()
        self.make_set(self.folder / "data/first", "img{}.pgm", "H1to{}p")

    def make_set(self, folder, image, homography, seed=1):
        folder.mkdir(parents=True)
        rows = picture(seed)
        write_pgm(folder / image.format(1), rows, 20, 20)
        for k, (x, y) in SHIFTS.items():
            write_pgm(folder / image.format(k), rows, 20 - x, 20 - y)
            (folder / homography.format(k)).write_text(translation(x, y))

    def evaluate(self, *arguments, **expected):
        return self.run_tool("ktgp_evaluate", "--force", "--features", 500, *arguments, **expected)

    def rows(self, *arguments, **expected):
        run = self.evaluate(*arguments, "--csv", "out.csv", code=None)
        if re.search(r"is not available in this OpenCV \(4\.[0-5]\.", run.stderr):
            self.skipTest(run.stderr.strip())
        self.check_end(run, **expected)
        return run, self.table()

    def test_a_method_that_fails_on_a_pair_fails_there_alone(self):
        file = self.folder / "data/first/img3.pgm"
        header, pixels = file.read_bytes().split(b"\n255\n", 1)
        width, height = map(int, header.split()[1:])
        file.write_bytes(b"P5\n%d %d\n255\n" % (width, height - 50) + pixels[:width * (height - 50)])
        run, rows = self.rows("data/first", "--methods", "KTGP,FLOW", code=1)
        self.assertRegex(run.stderr, "^ktgp_evaluate: first 1-3: FLOW failed: OpenCV: .+\n$")
        self.assertEqual([(r["pair"], r["method"]) for r in rows if r["problem"]], [("1-3", "FLOW")])
        self.assertEqual([r["found"] for r in rows], ["true", "true", "true", "false"] + 6 * ["true"])
        self.assertIn("FLOW", run.stdout)

    def test_oxford_folder(self):
        run, rows = self.rows("data/first")
        self.assertEqual(run.stderr, "")
        self.assertEqual([r["pair"] for r in rows[::6]], ["1-2", "1-3", "1-4", "1-5", "1-6"])
        self.assertEqual([r["method"] for r in rows[:6]],
                         ["ORB", "ORB+RANSAC", "KT", "KTG", "KTGP", "KTGP+ALIGN"])
        for row in rows:
            self.assertEqual(row["set"], "first")
            if row["method"] == "KTGP":
                self.assertGreater(float(row["precision_3px"]), 0.99)
                self.assertLess(float(row["corner_error"]), 2.5)
                self.assertEqual(len(row["steps_ms"].split(";")), 4)
                x, y = SHIFTS[int(row["pair"][2])]
                self.assertAlmostEqual(float(row["displacement_mean"]), (x * x + y * y) ** 0.5,
                                       delta=0.5)
            if row["method"] == "KTG":
                self.assertEqual(row["corner_error"], "")

    def test_hpatches_folder_and_list_agree_with_oxford(self):
        self.make_set(self.folder / "h" / "second", "{}.pgm", "H_1_{}")
        lines = [f"1-{k} first/img1.pgm first/img{k}.pgm first/H1to{k}p  # a comment"
                 for k in SHIFTS]
        self.write("data/third.txt", "# pairs\n\n" + "\n".join(lines) + "\n")
        run, rows = self.rows("data/first", "h", "data/third.txt", "--methods", "KTGP")
        self.assertEqual([r["set"] for r in rows], ["first"] * 5 + ["second"] * 5 + ["third"] * 5)
        for a, b, c in zip(rows[:5], rows[5:10], rows[10:]):
            for key in ("pair", "matches", "corner_error", "descriptor_distance_mean"):
                self.assertEqual(a[key], b[key])
                self.assertEqual(a[key], c[key])
        self.assertIn("all, 15 pairs", run.stdout)

    def test_hpatches_protocol(self):
        for name in ("v_first", "v_talent"):
            self.make_set(self.folder / "h" / name, "{}.pgm", "H_1_{}")
        run, rows = self.rows("--hpatches", "h")
        self.assertEqual({row["set"] for row in rows}, {"v_first"})
        methods = ["KTGP", "KTGP+ALIGN", "ROBUST", "SIFT+PROSAC", "AKAZE", "ORB+RANSAC"]
        self.assertEqual([row["method"] for row in rows[:6]], methods)
        for method in methods:
            errors = sorted(float(row["corner_error"] or "inf") for row in rows if row["method"] == method)
            expected = " ".join("%6.1f" % (100 * auc(errors, threshold)) for threshold in (1, 3, 5))
            line = next(line for line in run.stdout.splitlines() if line.startswith(method + " "))
            self.assertIn(expected, line)
        self.assertRegex(run.stdout, r"SuperPoint \+ LightGlue, PoseLib +37.1 +67.4 +77.8 +quoted")

        # The shorter side becomes 480 px, and the shift grows with it.
        aligned = next(row for row in rows if row["method"] == "KTGP+ALIGN")
        x, y = SHIFTS[2]
        self.assertAlmostEqual(float(aligned["displacement_mean"]),
                               (x * x + y * y) ** 0.5 * 480 / HEIGHT, delta=1.5)

        self.evaluate("--hpatches", "h", "--longest-side", 100, code=2)
        self.evaluate("--hpatches", "h/v_talent", code=1, words="--hpatches leaves out all of these sequences")

    @unittest.skipUnless(os.path.isdir(DOGMAN), "no sequence of HPatches")
    def test_a_sequence_of_hpatches(self):
        run, rows = self.rows("--hpatches", DOGMAN, "--methods", "ROBUST")
        self.assertEqual(len(rows), 5)
        self.assertIn("HPatches, 5 pairs (the papers: 540)", run.stdout)

    def test_jobs_change_nothing_but_the_times(self):
        def without_times(jobs):
            _, rows = self.rows("data", "--methods", "all", "--jobs", jobs)
            return [{k: v for k, v in row.items() if not k.endswith("ms")} for row in rows]

        self.assertEqual(without_times(1), without_times(4))

    def test_json_has_rows_summary_and_options(self):
        self.evaluate("data", "--json", "out.json", "--methods", "KTG,KTGP", "--T_G", "5",
                      "--repeat", "3")
        out = self.json()
        self.assertEqual(len(out["results"]), 10)
        self.assertEqual([s["method"] for s in out["summary"]], ["KTG", "KTGP"])
        self.assertEqual(out["options"]["T_G"], 5)
        self.assertEqual(out["problems"], [])
        ktg, ktgp = out["summary"]
        self.assertNotIn("auc_3", ktg)
        self.assertGreater(ktgp["auc_10"], 0.8)
        mean = sum(r["matches"] for r in out["results"] if r["method"] == "KTGP") / 5
        self.assertAlmostEqual(ktgp["matches"], mean)
        self.assertEqual([s["name"] for s in out["results"][1]["steps"]],
                         ["knn", "ratio", "gms", "prosac"])

    def test_broken_data_is_named_and_the_rest_goes_on(self):
        folder = self.folder / "data/first"
        (folder / "img2.pgm").unlink()
        (folder / "img3.pgm").write_text("no image")
        (folder / "H1to4p").write_text("1 2 3")
        run, rows = self.rows("data", "missing", "--methods", "KTGP", "--json", "out.json", code=1)
        self.assertEqual([r["pair"] for r in rows], ["1-5", "1-6"])
        for name in ("img2", "img3.pgm", "H1to4p", "missing"):
            self.assertIn(name, run.stderr)
        self.assertEqual(len(self.json()["problems"]), 4)

    def test_a_set_has_the_images_and_names_that_are_there(self):
        """Six images or more, with any usual ending; images without a truth, and what is no set, are named."""
        first = self.folder / "data/first"
        for k, ending in ((2, "PGM"), (3, "TIF"), (4, "bmp"), (5, "tiff"), (7, "pgm"), (8, "pgm")):
            cv2.imwrite(str(first / "new.pgm"), window(picture(), 20, 20))
            cv2.imwrite(str(first / ("new." + ending.lower())), window(picture(), 20, 20))
            (first / f"img{k}.pgm").unlink(missing_ok=True)
            (first / ("new." + ending.lower())).rename(first / f"img{k}.{ending}")
        shutil.copy(first / "H1to2p", first / "H1to7p")
        (self.folder / "data/extreme/h").mkdir(parents=True)
        for part in "12":
            (self.folder / "data/extreme" / part).mkdir()
            for name in "ab":
                write_pgm(self.folder / f"data/extreme/{part}/{name}.pgm", picture())
        self.write("data/extreme/h/a.txt", translation(0, 0))
        (self.folder / "data/points").mkdir()
        for name in ("aA", "aB", "bA", "bB"):
            write_pgm(self.folder / f"data/points/{name}.pgm", picture())
        self.write("data/points/a.points", "0 0 0 0\n200 0 200 0\n0 200 0 200\n200 200 200 200\n")
        for name in (".git", "photos"):
            (self.folder / "data" / name).mkdir()
        run, rows = self.rows("data", "--methods", "KT", code=1)
        self.assertEqual([f'{r["set"]} {r["pair"]}' for r in rows],
                         ["extreme a", "first 1-2", "first 1-3", "first 1-4", "first 1-5", "first 1-6", "first 1-7",
                          "points a"])
        self.assertEqual([line.split(": ")[1:3] for line in run.stderr.splitlines()],
                         [["data/extreme/h/b.txt", "is missing"], ["data/first/H1to8p", "is missing"],
                          ["data/points/b.points", "is missing"], ["data/photos", run.stderr.split("photos: ")[1].split(
                              ": ")[0].splitlines()[0]]])

    def test_two_folders_with_the_same_name_are_two_sets(self):
        shutil.copytree(self.folder / "data", self.folder / "other")
        shutil.copy(self.folder / "data/first/img2.pgm", self.folder / "data/first/img1.pgm")
        _, rows = self.rows("data", "other", "--methods", "KT")
        self.assertEqual([r["set"] for r in rows], 5 * ["first"] + 5 * ["other/first"])
        for options in ((), ("--two-view",)):
            self.write("data/first/cameras.txt", 2 * f"img1.pgm {CAMERA} 1 0 0 0 1 0 0 0 1 0 0 0\n")
            self.evaluate("data/first", "other/../data/first", *options, code=2,
                          words="other/../data/first is given twice")

    def test_a_truth_that_maps_nothing_into_the_other_image_is_a_problem(self):
        self.write("data/first/H1to3p", translation(WIDTH + 1, 0))
        _, rows = self.rows("data", "--methods", "KT", code=1,
                            words="first/img1.pgm: the true homography maps no point of it into data/first/img3.pgm")
        self.assertEqual([r["pair"] for r in rows], ["1-2", "1-4", "1-5", "1-6"])

    def test_without_a_match_there_is_no_error(self):
        for k in SHIFTS:
            write_pgm(self.folder / f"data/first/img{k}.pgm", np.full((HEIGHT, WIDTH), 128, np.uint8))
        run = self.evaluate("data", "--methods", "KT")
        self.assertRegex(run.stdout, r"KT +0\.0 +0\.0% +0\.0 +0\.0% +- \|")

    def test_annotated_points_on_a_line_are_named_and_the_rest_goes_on(self):
        (self.folder / "annotated").mkdir()
        for name, points in (("line", ((0, 0), (50, 25), (100, 50), (200, 100), (30, 90))),
                             ("plane", ((0, 0), (200, 10), (20, 150), (210, 160)))):
            write_pgm(self.folder / f"annotated/{name}A.pgm", picture(), 20, 20)
            write_pgm(self.folder / f"annotated/{name}B.pgm", picture(), 13, 24)
            self.write(f"annotated/{name}.points", "".join(f"{x} {y} {x + 7} {y - 4}\n" for x, y in points))
        _, rows = self.rows("annotated", "--methods", "KTGP", code=1,
                            words="annotated/line.points: the annotated points determine no homography")
        self.assertEqual([r["pair"] for r in rows], ["plane"])
        self.assertLess(float(rows[0]["corner_error"]), 1.0)

    def test_data_without_anything_usable(self):
        (self.folder / "empty").mkdir()
        self.write("list.txt", "only three words\n")
        for name in ("empty", "list.txt", "nowhere"):
            self.evaluate(name, code=1, words=name)

    def test_what_is_no_list_is_named_in_a_line(self):
        noise = random.Random(1).getrandbits(8 * 300000).to_bytes(300000, "little")
        for name, content, words in (("noise", noise, "is not a text file"),
                                     ("a.png", cv2.imencode(".png", picture())[1].tobytes(), "is a picture"),
                                     ("words.pgm", b"P2\n1 1\n255\n7\n", "is a picture"),
                                     ("a.mp4", b"\0\0\0\x18ftypisom" + bytes(100), "is a video"),
                                     ("a.bag", b"#ROSBAG V2.0\n" + noise, "is a bag of ROS 1")):
            (self.folder / name).write_bytes(content)
            text = self.evaluate(name, code=1, words=(f"{name}: {words}", "expected a list")).stderr
            self.assertLessEqual(text.count("\n"), 5 if name == "noise" else 1, text)

    def test_of_a_list_ten_bad_lines_are_named(self):
        for lines, words in ((10, "list.txt: 10 lines cannot be read; the rest of it was not read"), (9, "")):
            self.write("list.txt", lines * "only three words\n" + "1-2 data/first/img1.pgm data/first/img2.pgm "
                       "data/first/H1to2p\n")
            run, rows = self.rows("list.txt", "--methods", "KT", code=1, words=words)
            self.assertEqual(run.stderr.count("expected `name imageA"), lines)
            self.assertEqual(len(rows), 10 - lines)

    def test_files_that_cannot_be_read_are_a_problem_each(self):
        os.mkfifo(self.folder / "data" / "pipe")
        long = "long" * 100  # no file can have this name
        for name in ("pipe", long):
            self.write("data/list.txt",
                f"1-2 {name} first/img2.pgm first/H1to2p\n"
                f"1-3 first/img1.pgm {name} first/H1to3p\n"
                f"1-4 first/img1.pgm first/img4.pgm {name}\n"
                "1-5 first/img1.pgm first/img5.pgm first/H1to5p\n")
            run, rows = self.rows("data/list.txt", long, "--methods", "KTGP", "--json", "out.json", code=1)
            self.assertEqual([r["pair"] for r in rows], ["1-5"], run.stderr)
            self.assertEqual(len(self.json()["problems"]), 4)
            self.assertEqual(run.stderr.count("is not a regular file"), 3 if name == "pipe" else 0, run.stderr)

    def test_folder_without_its_first_image(self):
        (self.folder / "data/first" / "img1.pgm").unlink()
        self.evaluate("data/first", code=1, words="img1")

    def test_options_that_cannot_be_used(self):
        for arguments, text in ((("--methods", "KTX"), "KTX"),
                                (("--estimator", "best"), "best"),
                                (("--jobs", "0"), "--jobs"),
                                (("--T_w", "2"), "[0, 1]"),
                                (("--warps", "small", "--hpatches"), "excludes"),
                                (("--warps", "small", "--longest-side", "100"), "excludes"),
                                (("--warp-pairs", "4"), "requires --warps"),
                                (("--warp-seed", "4"), "requires --warps"),
                                (("--json", "no/folder.json"), "no/folder.json")):
            self.evaluate("data", *arguments, code=2, words=text)
        self.evaluate(code=2)

    def test_methods_are_listed(self):
        self.evaluate("--list-methods", prints=("KTGP ", "MP-ORB", "KRCR", "KTBER", "Sun2016", "GMS-RANSAC"))

    def test_estimator_can_be_chosen(self):
        for estimator in ("ransac", "msac", "mlesac", "prosac"):
            for row in self.rows("data", "--methods", "KTGP", "--estimator", estimator)[1]:
                self.assertIn(estimator + "=", row["steps_ms"])
                self.assertLess(float(row["corner_error"]), 2.5)

    def test_two_sets_are_averaged_together(self):
        shutil.copytree(self.folder / "data/first", self.folder / "data" / "second")
        self.evaluate("data", "--methods", "KT", "--json", "out.json")
        out = self.json()
        self.assertEqual([s["set"] for s in out["summary"]], ["first", "second", "all"])
        self.assertAlmostEqual(out["summary"][0]["matches"], out["summary"][2]["matches"])
        self.assertEqual(out["summary"][2]["pairs"], 10)

    def warps(self, kinds, *arguments, **expected):
        return self.rows("--warps", kinds, *arguments, "--warp-pairs", "4", "--json", "out.json", **expected)

    def test_warps_are_made_from_any_image_and_found_again(self):
        run, rows = self.warps("small", "data/first/img1.pgm", "--methods", "KTGP,KTGP+ALIGN,ECC")
        self.assertEqual([r["pair"] for r in rows[::3]], ["0", "1", "2", "3"])
        for row in rows:
            self.assertEqual(row["set"], "small")
            self.assertEqual(row["found"], "true")
            self.assertLess(float(row["corner_error"]), 3.0, row)
            self.assertGreater(float(row["zncc"]), 0.9, row)
        out = self.json()
        self.assertEqual(out["warps"], {"kinds": "small", "pairs": 4, "seed": 1})
        for summary in out["summary"]:
            self.assertGreater(summary["auc_3"], 0.5)
            self.assertLessEqual(summary["auc_1"], summary["auc_10"])
            self.assertEqual(summary["found"], 1.0)
            self.assertEqual(summary["wrong"], 0.0)
            self.assertLess(summary["median_corner_error"], 2.0)
            self.assertGreater(summary["zncc"], 0.9)
        plain, aligned, _ = out["summary"]
        self.assertLess(aligned["median_corner_error"], 0.5 * plain["median_corner_error"])
        self.assertGreater(aligned["auc_1"], plain["auc_1"])
        for word in ("AUC@1", "median", "found", "wrong", "ZNCC", "true/p", "e'S^-1e", "99.9%"):
            self.assertIn(word, run.stdout)

    def test_the_covariance_is_held_to_the_truth(self):
        _, rows = self.warps("small", "data/first/img1.pgm", "--methods", "KTGP,ROBUST,ECC")
        for row in rows:
            if row["method"] == "ECC":  # gives none
                self.assertEqual(row["predicted_corner_error"], "")
                continue
            self.assertAlmostEqual(
                float(row["corner_error_ratio"]) * float(row["predicted_corner_error"]),
                float(row["corner_error"]), delta=0.5 * float(row["corner_error"]))
            self.assertGreaterEqual(int(row["corners_consistent"]), 3, row)
        summaries = self.json()["summary"]
        robust = next(s for s in summaries if s["method"] == "ROBUST")
        self.assertGreater(robust["corners_consistent"], 0.9)
        self.assertGreater(robust["corner_normalised_median"], 0.1)
        self.assertLess(robust["corner_normalised_median"], 4.0)

    @unittest.skipUnless(os.path.isdir(KITTI), "KTGP_ORB_DATA is not set: this test needs its folder two_view")
    def test_no_pair_of_a_street_has_the_direction_of_a_local_optimum(self):
        self.run_tool("ktgp_evaluate", "--two-view", KITTI, "--methods", "SLAM", "--csv", "views.csv")
        errors = [float(row["error"]) for row in self.table("views.csv")]
        self.assertEqual(len(errors), 50)
        self.assertLess(max(errors), 2.0)  # degrees

    @unittest.skipUnless(os.path.isdir(KITTI), "KTGP_ORB_DATA is not set: this test needs its folder two_view")
    def test_two_views_of_a_street_are_better_than_its_rivals(self):
        (self.folder / "street").mkdir()
        with open(os.path.join(KITTI, "cameras.txt")) as file:
            rows = file.read().splitlines()[9:17]
        self.write("street/cameras.txt", "\n".join(rows) + "\n")
        for row in rows:
            shutil.copy(os.path.join(KITTI, row.split()[0]), self.folder / "street")
        self.run_tool("ktgp_evaluate", "--force", "--two-view", "street", "--methods",
                      "SLAM,KTG+MAGSAC++,GMS+MAGSAC++", "--apart", "1", "--csv", "views.csv", prints=("AUC at 1, 2, 5, 10 deg", "street, 1 apart"))
        rows = self.table("views.csv")
        self.assertEqual(len(rows), 7 * 3)

        def errors(method):
            return [float(r["error"]) for r in rows if r["method"] == method]
        ours = auc(errors("SLAM"), 5)
        self.assertGreater(ours, 0.85)
        self.assertGreater(ours, auc(errors("KTG+MAGSAC++"), 5))
        self.assertGreater(ours, auc(errors("GMS+MAGSAC++"), 5))
        for row in rows:
            if row["method"] == "SLAM":
                self.assertEqual(row["geometry"], "epipolar")
                self.assertGreater(float(row["kept"]), 0.97)
                # Keypoints in all parts of the image include weak ones: one pair has 0.937.
                self.assertGreater(float(row["precision"]), 0.92)
        precisions = [float(row["precision"]) for row in rows if row["method"] == "SLAM"]
        self.assertGreater(sum(precisions) / len(precisions), 0.95)
        self.run_tool("ktgp_evaluate", "--force", "--two-view", "street", "--methods", "SLAM", "--distribution",
                      "ranked", "--csv", "strongest.csv", prints=("street, 1 apart",))
        for row in self.table("strongest.csv"):
            self.assertGreater(float(row["precision"]), 0.95)

    def test_cameras_that_cannot_be_read_are_named(self):
        (self.folder / "bad").mkdir()
        self.evaluate("--two-view", "bad", code=1, words="bad/cameras.txt")
        right = f"a.png {CAMERA} 1 0 0 0 1 0 0 0 1 0 0 0\n"
        for row, words in (("a.png 1 2 3", "line 2 is not `file fx fy cx cy R11"),
                           (right.strip() + " 0 0 0 1", "line 2 is not `file fx fy cx cy R11"),
                           (f"a.png {CAMERA} 1 0 0 5 0 1 0 6 0 0 1 7", "line 2 has an R that is no rotation"),
                           (f"a.png {CAMERA} 2 0 0 0 2 0 0 0 2 0 0 0", "line 2 has an R that is no rotation"),
                           (f"a.png {CAMERA} 0 0 0 0 0 0 0 0 0 0 0 0", "line 2 has an R that is no rotation"),
                           (f"a.png {CAMERA} -1 0 0 0 1 0 0 0 1 0 0 0", "line 2 has an R that is no rotation")):
            self.write("bad/cameras.txt", right + row + "\n")
            self.evaluate("--two-view", "bad", code=1, words=("bad/cameras.txt: " + words,))
        self.write("bad/cameras.txt", "\n")
        self.evaluate("--two-view", "bad", code=1, words="bad/cameras.txt: has no row `file fx fy")
        self.evaluate("--two-view", "bad", "--methods", "MAGIC", code=2,
                      words="there is no method MAGIC of two views; expected one of SLAM")

    def test_an_option_that_two_views_do_not_use_is_refused(self):
        for option in ("--json=o.json", "--jobs=2", "--repeat=3", "--estimator=magsac", "--longest-side=100",
                       "--truth-deviation=1", "--warps=small", "--hpatches"):
            self.evaluate("--two-view", "bad", option, code=2, words="excludes")

    def test_pairs_that_cannot_be_are_named(self):
        (self.folder / "bad").mkdir()
        row = f" {CAMERA} 1 0 0 0 1 0 0 0 1 0 0 0\n"
        self.write("bad/cameras.txt", "a.png" + row + "b.png" + row)
        self.evaluate("--two-view", "bad", "--apart", "1,2", code=1,
                      words="bad/cameras.txt: has 2 rows: no pair is 2 rows apart")
        for text, words in (("0 2\n", "line 1 has a row number beyond the 2 rows of cameras.txt"),
                            ("0 one\n", "line 1 is not two row numbers"), ("0 1\n1\n", "line 2 is not two row"),
                            ("0 1\n\n0 1 1\n", "line 3 is not two row"), ("", "names no pair")):
            self.write("bad/pairs.txt", text)
            self.evaluate("--two-view", "bad", code=1, words="bad/pairs.txt: " + words)

    def make_turn(self, name, third_camera=CAMERA, third=(HEIGHT, WIDTH)):
        """A folder with two views of a camera that only turned, far from the origin, in numbers of six digits, and a
        third image."""
        (self.folder / name).mkdir()
        K = np.array([[300, 0, 160], [0, 300, 120], [0, 0, 1.0]])
        rows = ""
        for file, camera, angle in (("a.pgm", CAMERA, 0.3), ("b.pgm", CAMERA, 0.36), ("c.pgm", third_camera, 0.3)):
            R = cv2.Rodrigues(np.array([0, angle, 0.1]))[0]
            numbers = [f"{x:.6g}" for x in (*R.ravel(), *(-R @ (100, 200, 30)))]
            rows += f"{file} {camera} {' '.join(numbers)}\n"
            H = K @ R @ cv2.Rodrigues(np.array([0, 0.33, 0.1]))[0].T @ np.linalg.inv(K)
            view = cv2.warpPerspective(window(picture(), 20, 20), H, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
            cv2.imwrite(self.path(name, file), view if file != "c.pgm" else np.full(third, 128, np.uint8))
        self.write(name + "/cameras.txt", rows)

    def test_a_turn_is_one_in_rounded_numbers_and_its_matches_are_judged_by_it(self):
        self.make_turn("turn")
        self.write("turn/pairs.txt", "0 1\n0 0\n")
        self.evaluate("--two-view", "turn", "--apart", "1", "--csv", "views.csv", "--methods", "SLAM,KTGP+MAGSAC++",
                      words="turn/pairs.txt lists the pairs: --apart has no effect", prints="100.0")
        rows = self.table("views.csv")
        self.assertEqual(len(rows), 4)
        for row in (rows[0], rows[2]):
            self.assertEqual((row["method"], row["geometry"]), ("SLAM", "rotation"))
            self.assertLess(float(row["error"]), 0.1, row)
        for row in rows[:3]:  # OpenCV finds no essential matrix of an image and itself
            self.assertGreater(float(row["precision"]), 0.75, row)
            self.assertGreater(float(row["kept"]), 0.5, row)

    def test_a_camera_that_does_not_fit_its_image_is_a_problem_of_its_pairs(self):
        for name, camera, size, words in (("none", "0 300 160 120", (HEIGHT, WIDTH), "fx of K of focal_none/c.pgm is 0"),
                                          ("half", CAMERA, (HEIGHT // 2, WIDTH // 2), "another image size?")):
            self.make_turn("focal_" + name, camera, size)
            self.write(f"focal_{name}/pairs.txt", "0 2\n0 1\n")
            self.evaluate("--two-view", "focal_" + name, "--csv", "views.csv", "--methods", "SLAM", code=1,
                          words=(f"focal_{name} a.pgm c.pgm: ", words))
            self.assertEqual([row["pair"] for row in self.table("views.csv")], ["a.pgm b.pgm"])

    def test_tiny_warps_are_those_of_a_slow_camera(self):
        """KTGP+ALIGN measures their hundredths of a pixel, where keypoints alone are tenths off."""
        _, rows = self.warps("tiny", "data/first/img1.pgm", "--methods", "KTGP,KTGP+ALIGN")
        errors = {method: [float(r["corner_error"]) for r in rows if r["method"] == method]
                  for method in ("KTGP", "KTGP+ALIGN")}
        self.assertEqual([len(e) for e in errors.values()], [4, 4])
        self.assertGreater(min(errors["KTGP"]), 0.1)
        self.assertLess(max(errors["KTGP+ALIGN"]), 0.15)

    def test_warps_of_a_folder_by_kind_and_by_seed(self):
        def errors(*arguments):
            _, rows = self.warps("small,medium", "data/first", "--methods", "KTGP", *arguments)
            self.assertEqual([r["set"] for r in rows], ["small"] * 4 + ["medium"] * 4)
            return [r["corner_error"] for r in rows]

        self.assertEqual(errors(), errors("--jobs", "2"))
        self.assertNotEqual(errors(), errors("--warp-seed", "2"))

    def test_warps_that_cannot_be_made(self):
        self.evaluate("--warps", "huge", "data/first/img1.pgm", code=2, words="tiny, small, medium, large or extreme")
        self.write("text.png", "no image")
        run, rows = self.warps("small", "nowhere.png", "text.png", "data/first/img1.pgm", "--methods", "KTGP", code=1)
        self.assertEqual(len(rows), 2, "every second warp is of the image that can be read")
        self.assertIn("nowhere.png", run.stderr)
        self.assertIn("text.png", run.stderr)

    def test_peers_are_listed_and_run_or_say_what_is_missing(self):
        listed = self.evaluate("--list-methods").stdout
        for name in ("SIFT", "AKAZE", "FLOW", "ECC"):
            line = next(x for x in listed.splitlines() if x.startswith(name + " "))
            if "not available in this OpenCV" in line:
                self.evaluate("data", "--methods", name, code=2, words="not available in this OpenCV")
                continue
            run, rows = self.rows("data", "--methods", name)
            for row in rows:
                self.assertLess(float(row["corner_error"]), 3.0, row)
                self.assertEqual(row["total_ms"], row["ms"], "without our features")
