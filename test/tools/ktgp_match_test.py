"""Runs ktgp_match as a program."""
import os
import re
import struct
import subprocess

import cv2
import numpy as np
from tool_case import (HEIGHT, OVER_A_PLANE, SOURCE, TOOLS, WIDTH, PairCase, corners_off, mapped, picture, shift,
                       tilted_plane, two_depths, window, write_pgm, write_tiff)

SKY = 800, 600  # px


def sky(motion, hot, noise, count=450):
    """Stars, moved by a homography, and pixels of the sensor that are always bright; with noise of that seed."""
    width, height = SKY
    numbers, sensor = np.random.RandomState(5), np.random.RandomState(9)
    image = np.random.RandomState(noise).normal(12.0, 2.5, (height, width))
    stars = mapped(motion, numbers.uniform((-40, -40), (width + 40, height + 40), (count, 2)))
    y, x = np.mgrid[:height, :width]
    for (at_x, at_y), light in zip(stars, numbers.uniform(60, 240, len(stars))):
        near = tuple(slice(max(0, int(at) - 6), max(0, int(at) + 7)) for at in (at_y, at_x))
        image[near] += light * np.exp(-((x[near] - at_x) ** 2 + (y[near] - at_y) ** 2) / 2.5)
    image[sensor.randint(0, height, hot), sensor.randint(0, width, hot)] = sensor.uniform(60, 240, hot)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def turn(degrees):
    """About the middle of the sky."""
    middle = (SKY[0] - 1) / 2, (SKY[1] - 1) / 2
    return np.vstack([cv2.getRotationMatrix2D(middle, degrees, 1.0), (0, 0, 1)])


def camera_over_map(x, y, height, degrees):
    """Map -> image of 640x480 of a camera `y` px below the map's upper edge and `height` px above it, that looks up the
    map and down by `degrees`."""
    t = np.radians(degrees)
    rotation = np.array([[1, 0, 0], [0, np.sin(t), -np.cos(t)], [0, -np.cos(t), -np.sin(t)]])
    K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    return K @ np.column_stack([rotation[:, 0], rotation[:, 1], -rotation @ (x, y, height)])


def view_of_map(ground, H):
    """Its view, grey beyond the horizon and beside the map, and where it shows the map."""
    y, x = np.mgrid[:480, :640]
    on_map = mapped(np.linalg.inv(H), np.stack([x, y], axis=-1).reshape(-1, 2))
    is_seen = (on_map @ H[2, :2] + H[2, 2] > 0) & (on_map >= 0).all(axis=1)
    is_seen = (is_seen & (on_map < np.array(ground.shape[::-1]) - 1).all(axis=1)).reshape(480, 640)
    return np.where(is_seen, cv2.warpPerspective(ground, H, (640, 480)), 128).astype(np.uint8), is_seen


class KtgpMatch(PairCase):
    def match(self, *arguments, **expected):
        """With the preset ktgp unless the arguments begin from another one."""
        usual = () if {"--preset", "--params"} & set(arguments) else ("--preset", "ktgp")
        return self.match_photos(*arguments, *usual, **expected)

    def match_photos(self, *arguments, **expected):
        return self.run_tool("ktgp_match", "--force", *arguments, **expected)

    def grey(self, name):
        return cv2.imread(self.path(name), cv2.IMREAD_GRAYSCALE)

    def write_image(self, name, pixels):
        self.assertTrue(cv2.imwrite(self.path(name), pixels))

    def test_it_starts_without_the_hundred_libraries_of_videos(self):
        libraries = subprocess.check_output(["ldd", os.path.join(TOOLS, "ktgp_match")], universal_newlines=True)
        self.assertIn("libopencv_imgcodecs", libraries)
        self.assertNotIn("libopencv_videoio", libraries)

    def test_the_default_finds_a_tilted_view_that_the_paper_s_chain_does_not(self):
        tilt = np.float32([[0.25, -0.3, 120], [0.12, 0.75, 10], [0, 0, 1]])
        self.write_image("tilted.png", cv2.warpPerspective(self.grey("a.pgm"), tilt, (WIDTH, HEIGHT),
                                                           flags=cv2.INTER_AREA))
        self.write("tilt.txt", " ".join(map(str, tilt.ravel())))
        self.match("a.pgm", "tilted.png", code=1, prints="--preset photo finds more")
        run = self.match_photos("a.pgm", "tilted.png", "--ground-truth", "tilt.txt")
        error = float(re.search(r"corner error against the ground truth: (\S+) px", run.stdout).group(1))
        self.assertLess(error, 3.0)

    def test_two_parts_of_a_plan_that_share_only_its_symbols_are_said_to_repeat(self):
        random = np.random.RandomState(1)
        plan = np.full((800, 1600), 255, np.uint8)
        for x in range(60, 1560, 100):
            for y in range(60, 760, 100):
                cv2.rectangle(plan, (x, y), (x + 40, y + 50), 0, 2)
                cv2.circle(plan, (x + 20, y + 25), 12, 0, 2)
                cv2.putText(plan, str(random.randint(100)), (x + 46, y + 30), cv2.FONT_HERSHEY_SIMPLEX, .6, 0, 1)
        for name, left, degrees in (("left.png", 0, 0.4), ("right.png", 800, -0.7)):
            scan = cv2.getRotationMatrix2D((left + 400, 400), degrees, 1)
            scan[0, 2] -= left
            part = cv2.warpAffine(plan, scan, (800, 800), flags=cv2.INTER_AREA, borderValue=255)
            noisy = cv2.GaussianBlur(part, (0, 0), 0.7) + random.normal(0, 4, part.shape)
            self.write_image(name, np.clip(noisy, 0, 255).astype(np.uint8))
        self.match_photos("left.png", "right.png", code=1, prints="what both images show repeats itself")
        self.assertNotIn("repeats itself", self.match_photos("a.pgm", "left.png", code=1).stdout)

    def test_a_misspelt_parameter_has_the_nearest_name_in_the_message(self):
        for word, meant in (("--t_w", "--T_w"), ("--ground_truth=H.txt", "--ground-truth"), ("--featurs", "--features")):
            self.match("a.pgm", "b.pgm", word, "0.7", code=2,
                       words=f"not expected: {word.split('=')[0]}; did you mean {meant}?\n")
        self.assertNotIn("did you mean", self.match("a.pgm", "b.pgm", "--nonsense", code=2).stderr)
        self.write("mine.yaml", "t_g: 3\n")
        self.match("a.pgm", "b.pgm", "--params", "mine.yaml", code=2,
                   words="mine.yaml: there is no parameter t_g; did you mean T_G?\n")

    def test_more_than_two_images_are_counted(self):
        self.match("a.pgm", "b.pgm", "c.pgm", "d.pgm", code=2, words="expected A and B, but 4 names came\n")

    def test_hot_pixels_are_not_taken_for_the_sky(self):
        """Hot pixels agree that nothing moves, and may be more than the stars."""
        moved, turned = shift(4.6, 0), shift(4.6, 0) @ turn(3)
        cases = [(preset, motion, hot) for preset, motion in (("robust", moved), ("robust", turned), ("photo", turned))
                 for hot in (200, 900)]
        right = 0
        for seed, (preset, motion, hot) in enumerate(cases):
            self.write_image("before.png", sky(np.eye(3), hot, seed))
            self.write_image("after.png", sky(motion, hot, seed + 100))
            self.match_photos("before.png", "after.png", "--preset", preset, "--json", "out.json", code=None)
            found = self.json()
            if found["status"] != "ok":
                continue
            off = np.linalg.norm(corners_off(found["homography"], motion, SKY), axis=1).max()
            self.assertLess(off, 1.0, (preset, hot))
            right += 1
        self.assertGreaterEqual(2 * right, len(cases))

    def check_sky(self, preset, motion, hot, stars):
        self.write_image("before.png", sky(np.eye(3), hot, 0, stars))
        self.write_image("after.png", sky(motion, hot, 100, stars))
        self.match_photos("before.png", "after.png", "--preset", preset, "--json", "out.json", code=None)
        found = self.json()
        self.assertEqual(found["status"], "ok")
        off, still = (np.linalg.norm(corners_off(found["homography"], truth, SKY), axis=1).max()
                      for truth in (motion, np.eye(3)))
        self.assertLess(off, 1.0, f"{found['inliers']} inliers; {still:.2f} px from standing still")

    def test_hot_pixels_do_not_bend_a_sky_that_moves_by_less_than_two_thresholds(self):
        for preset, hot, stars in (("photo", 900, 450), ("robust", 900, 350), ("photo", 900, 350),
                                   ("robust", 200, 250), ("photo", 200, 250), ("photo", 900, 250)):
            with self.subTest(preset=preset, hot=hot, stars=stars):
                self.check_sky(preset, shift(4.6, 0), hot, stars)
        self.check_sky("photo", shift(4.6, 0) @ turn(3), 900, 250)

    def test_a_plane_of_which_a_part_lies_behind_the_camera_is_found(self):
        """The map goes on behind the camera, or the horizon is in the view."""
        ground = np.vstack([np.hstack([picture(1), picture(2)]), np.hstack([picture(3), picture(4)])])
        self.write_image("map.png", ground)
        for y, height, degrees in ((400, 150, 35), (640, 200, 20), (300, 120, 30)):
            H = camera_over_map(ground.shape[1] / 2, y, height, degrees)
            view, is_seen = view_of_map(ground, H)
            self.write_image("view.png", view)
            shown = np.argwhere(is_seen[::20, ::20])[:, ::-1] * 20.0
            places = {"view.png": shown, "map.png": mapped(np.linalg.inv(H), shown)}
            for first, second in (("map.png", "view.png"), ("view.png", "map.png")):
                run = self.match_photos(first, second, "--json", "out.json")
                self.assertNotIn("warning: uncertain", run.stdout)
                off = mapped(self.json()["homography"], places[first]) - places[second]
                self.assertLess(np.linalg.norm(off, axis=1).max(), 1.0, (first, degrees))

    def test_the_uncertainty_of_the_corners_is_said_and_a_large_one_warned_of(self):
        sharp = self.match_photos("a.pgm", "b.pgm")
        deviation = r"standard deviation of the least certain corner of what both show: (\S+) px"
        self.assertLess(float(re.search(deviation, sharp.stdout).group(1)), 0.3)
        self.assertNotIn("warning", sharp.stdout)
        for sigma, is_uncertain in ((3.5, False), (5.0, True)):  # 1.2 and 3.9 px
            self.write_image("blurred.png", cv2.GaussianBlur(self.grey("a.pgm"), (0, 0), sigma))
            run = self.match_photos("a.pgm", "blurred.png", "--json", "out.json")
            self.assertEqual(self.json()["corner_deviation"] > 3, is_uncertain)
            warning = re.search(r"\nwarning: uncertain where there are no inliers: they cover \d+ %", run.stdout)
            self.assertEqual(bool(warning), is_uncertain, run.stdout)

    def test_a_homography_of_a_scene_with_depth_is_warned_of(self):
        """Blur costs a plane matches, too, but not to a scene with depth."""
        first = self.grey("a.pgm")
        K = np.array([[0.8 * WIDTH, 0, WIDTH / 2], [0, 0.8 * WIDTH, HEIGHT / 2], [0, 0, 1]])
        self.write_image("depth.png", two_depths(first, K, 0.25, np.array([-0.95, 0.1, 0.2])))
        self.write_image("blurred.png", cv2.GaussianBlur(self.grey("b.pgm"), (0, 0), 3.0))
        for name, is_warned in (("depth.png", True), ("b.pgm", False), ("blurred.png", False)):
            run = self.match_photos("a.pgm", name, prints="homography A -> B")
            warning = re.search(r"\nwarning: the scene is no plane: (\d+) matches .*, (\d+) with this", run.stdout)
            self.assertEqual(bool(warning), is_warned, run.stdout)
            if warning:
                self.assertGreater(int(warning.group(1)), 1.3 * int(warning.group(2)))

    def test_corners_outside_the_target_do_not_count(self):
        """Beyond the border of the target, the homography of a cut-out is extrapolated."""
        self.write_image("part.png", self.grey("a.pgm")[40:200, 60:260])
        self.match_photos("a.pgm", "part.png", "--json", "out.json")
        found = self.json()
        C, H = np.reshape(found["covariance"], (8, 8)), np.array(found["homography"])

        def deviation(x, y):
            w = H[2] @ (x, y, 1.0)
            u, v = H[:2] @ (x, y, 1.0) / w
            J = np.array([[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]) / w
            return np.sqrt(np.trace(J @ C @ J.T))

        inside = max(deviation(x, y) for x in (60, 259) for y in (40, 199))
        self.assertAlmostEqual(found["corner_deviation"], inside, delta=0.05 * inside)
        self.assertGreater(deviation(0, 0), 1.2 * inside)
        self.assertEqual(len(found["corners"]), 4)
        for corner in found["corners"]:
            x, y = corner["reference"]
            p = H @ (x, y, 1.0)
            np.testing.assert_allclose(corner["target"], p[:2] / p[2], atol=1e-6)
            self.assertAlmostEqual(corner["deviation"], deviation(x, y), delta=1e-6)
            self.assertLess(min(abs(x - 60), abs(x - 259)) + min(abs(y - 40), abs(y - 199)), 3)

    def test_the_table_says_what_is_off_and_names_one_number_of_inliers(self):
        run = self.match_photos("a.pgm", "b.pgm", "--json", "out.json")
        self.assertRegex(run.stdout, r"\ngms +off\n")
        self.assertRegex(run.stdout, r"\ngrowth +not needed\n")
        self.assertRegex(run.stdout, r"\ntf .*T_w 1, both nearest to each other \(mutual\)")
        self.assertEqual(set(re.findall(r"(\d+) inliers", run.stdout) + re.findall(r"inliers +(\d+):", run.stdout)),
                         {str(self.json()["inliers"])})

    def test_each_parameter_of_the_table_is_used_or_refused_or_named_as_without_effect(self):
        self.check_each_parameter_of_pairs("ktgp_match", "a.pgm", "b.pgm", same={
            "threads", "gms_rotation", "gms_scale", "fast_adaptive",  # the views are neither turned, nearer nor dark
            "views"})  # where PROSAC finds nothing

    def test_an_image_of_a_node_that_is_not_used_is_named(self):
        """A file of a node may have a reference_image, which is not the one that is matched: A is."""
        for mode in ("previous", "fixed"):
            self.write("node.yaml", f"reference_image: /no/such.png\nreference_mode: {mode}\nmax_rate: 5.0\n")
            self.match("a.pgm", "b.pgm", "--params", "node.yaml",
                       words="without effect in this run: reference_image, max_rate\n")
        self.write("all.yaml", "lazy: true\nmax_rate: 0.0\nreference_image: ''\n")  # the defaults
        self.assertEqual(self.match("a.pgm", "b.pgm", "--params", "all.yaml").stderr, "")
        self.match("a.pgm", "b.pgm", "--search_radius", "48", words="without effect in this run: search_radius\n")

    def test_there_is_advice_where_nothing_is_found(self):
        write_pgm(self.folder / "other.pgm", picture(seed=2))
        self.match_photos("a.pgm", "other.pgm", code=1, prints="try: no plane that both images show")
        write_pgm(self.folder / "grey.pgm", np.full((HEIGHT, WIDTH), 90, np.uint8))
        self.match_photos("a.pgm", "grey.pgm", code=1, prints="try: an image has hardly any corners")

    def test_large_images_that_are_not_found_should_be_made_smaller(self):
        noise = np.random.RandomState(1)
        for side, words in ((2600, "the images are 2600 px long; made 1000 to 2500 px long first"), (2400, None)):
            for name in ("long1.png", "long2.png"):
                self.write_image(name, noise.randint(0, 256, (200, side), np.uint8))
            for preset in ("ktgp", "photo"):
                run = self.match("long1.png", "long2.png", "--preset", preset, code=1, prints=("try: ", words or ""))
                self.assertEqual("px long" in run.stdout, words is not None, run.stdout)

    def test_prints_the_four_stages_and_the_homography(self):
        run = self.match("a.pgm", "b.pgm", prints=("reference", "target", "knn", "tf", "gms", "prosac", "homography"))
        self.assertEqual(run.stderr, "")
        self.assertNotIn("corner error", run.stdout)

    def test_a_scene_with_depth_has_the_motion_of_the_camera(self):
        first = self.grey("a.pgm")
        height, width = first.shape
        K = np.array([[0.8 * width, 0, width / 2], [0, 0.8 * width, height / 2], [0, 0, 1]])
        direction = np.array([-0.95, 0.1, 0.2]) / np.linalg.norm([-0.95, 0.1, 0.2])
        self.write_image("depth.png", two_depths(first, K, 0.25, direction))
        camera = ",".join(map(str, (K[0, 0], K[1, 1], K[0, 2], K[1, 2])))
        run = self.match("a.pgm", "depth.png", "--preset", "slam", "--camera", camera, "--json", "out.json",
                         "--draw", "depth_matches.png")
        self.assertRegex(run.stdout, r"geometry: epipolar, \d+ inliers, RMSE \S+ px, parallax \S+ degrees")
        self.assertIn("motion A -> B", run.stdout)
        self.assertIn("standard deviation: rotation", run.stdout)
        self.assertNotIn("no homography", run.stdout)
        self.assertTrue((self.folder / "depth_matches.png").exists())
        out = self.json()
        self.assertEqual(out["options"]["features"], 4000)
        self.assertEqual((out["status"], out["geometry"], out["found_by"]), ("ok", "epipolar", "two_view"))
        self.assertGreater(len(out["two_view"]["points"]), 100)
        self.assertEqual(out["two_view"]["doubt"], "none")
        self.assertGreater(out["two_view"]["probability"], 0.9)
        self.match("a.pgm", "depth.png", "--preset", "slam", "--camera", camera, "--csv", "out.csv")
        depths = [(float(row["z"]) * 0.25, float(row["reference_x"])) for row in self.table() if row["z"]]
        self.assertEqual(len(depths), len(out["two_view"]["points"]))
        near = [z for z, x in depths if x < 0.4 * width]
        self.assertAlmostEqual(np.median(near), 2.0, delta=0.1)
        self.assertIsNone(out["homography"])
        self.assertGreater(np.dot(out["two_view"]["pose"]["translation"], direction), 0.999)
        self.assertEqual(len(out["two_view"]["pose_covariance"]), 36)
        self.match("a.pgm", "depth.png", "--geometry", "auto", "--preset", "slam",
                   prints="fundamental matrix (--camera fx,fy,cx,cy gives the motion)")
        plane = self.match("a.pgm", "b.pgm", "--preset", "slam", "--camera", camera)
        self.assertRegex(plane.stdout, r"geometry: (plane|rotation), ")
        self.assertIn("homography A -> B", plane.stdout)

    def test_a_turn_has_no_direction(self):
        first = self.grey("a.pgm")
        height, width = first.shape
        K = np.array([[0.8 * width, 0, width / 2], [0, 0.8 * width, height / 2], [0, 0, 1]])
        turn = K @ cv2.Rodrigues(np.array([0.01, 0.03, 0.02]))[0] @ np.linalg.inv(K)
        self.write_image("turned.png", cv2.warpPerspective(first, turn, (width, height)))
        run = self.match("a.pgm", "turned.png", "--preset", "slam", "--camera",
                         ",".join(map(str, (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))), "--json", "out.json")
        self.assertEqual(self.json()["geometry"], "rotation")
        covariance = np.reshape(self.json()["two_view"]["pose_covariance"], (6, 6))
        self.assertIn("translation %.2g of the distance of the scene" % np.sqrt(np.trace(covariance[:3, :3])), run.stdout)
        self.assertNotIn("direction", run.stdout)

    def test_a_plane_has_both_motions(self):
        first = self.grey("a.pgm")
        height, width = first.shape
        K = np.array([[0.8 * width, 0, width / 2], [0, 0.8 * width, height / 2], [0, 0, 1]])
        self.write_image("plane.png", tilted_plane(first, K, 0.5))
        self.match("a.pgm", "plane.png", "--preset", "slam", "--camera",
                   ",".join(map(str, (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))), "--json", "out.json")
        out = self.json()
        self.assertEqual((out["status"], out["geometry"]), ("ok", "plane"))
        view = out["two_view"]
        other = view["other_pose"]
        self.assertEqual((view["doubt"], other["geometry"]), ("two_motions_of_a_plane", "plane"))
        self.assertAlmostEqual(view["probability"] + other["probability"], 1.0, places=9)
        translations = [np.array(motion["translation"]) for motion in (view["pose"], other)]
        for translation in translations:
            self.assertAlmostEqual(np.linalg.norm(translation), 1.0, places=9)
        self.assertLess(np.dot(*translations), 0.99)
        direction = OVER_A_PLANE / np.linalg.norm(OVER_A_PLANE)
        self.assertGreater(max(translation @ direction for translation in translations), 0.99)
        turn = np.array(other["rotation"]).reshape(3, 3)
        self.assertLess(np.abs(turn @ turn.T - np.eye(3)).max(), 1e-9)
        covariance = np.array(other["covariance"]).reshape(6, 6)
        self.assertLess(np.abs(covariance - covariance.T).max(), 1e-12)
        self.assertGreater(np.diag(covariance).min(), 0.0)

    def test_pictures_of_colours_are_drawn_in_colour(self):
        for name in ("a", "b"):
            grey = self.grey(name + ".pgm")
            self.write_image(name + ".png", cv2.merge([grey // 2, grey, 255 - grey]))
        for option in ("--draw", "--draw-stages", "--draw-final"):
            self.match("a.png", "b.png", option, "drawn.png")
            drawn = cv2.imread(self.path("drawn.png")).astype(int)
            # The median: lines and texts, which have colours of their own, cover less than half.
            self.assertGreater(np.median(abs(drawn[:, :, 0] - drawn[:, :, 2])), 30)

    def test_a_camera_that_cannot_be_used_is_refused(self):
        for words, reason in ((("--camera", "1,2,3", "--preset", "slam"), "1,2,3 is no camera; expected fx,fy,cx,cy"),
                              (("--camera", "a,2,3,4", "--preset", "slam"), "a,2,3,4 is no camera; expected fx,fy"),
                              (("--camera", "500,500,200,150"), "--camera is of use with --geometry auto"),
                              (("--camera", "0,0,0,0", "--preset", "slam"),
                               "fx of the K of the reference camera is 0; expected"),
                              (("--camera", "500,500,9000,150", "--preset", "slam"), "another image size"),
                              (("--camera", "1,1,0,0", "--preset", "slam"),
                               "fx of the K of the reference camera is 1; expected a focal length in [48, 16000] px"),
                              (("--target-camera", "500,500,160,120", "--preset", "slam"), "--camera"),
                              (("--camera", "nan,500,200,150", "--preset", "slam"), "")):
            self.match("a.pgm", "b.pgm", *words, code=2, words=reason)

    def test_images_of_two_sizes_have_a_camera_each(self):
        self.write_image("large.png", cv2.resize(self.grey("b.pgm"), None, fx=2, fy=2))
        slam = "--preset", "slam", "--camera", "300,300,160,120"
        self.match("a.pgm", "large.png", *slam, code=2, words="cannot share a K; expected a K of each")
        self.match("a.pgm", "large.png", *slam, "--target-camera", "600,600,320.5,240.5", "--json", "out.json")
        self.assertEqual(self.json()["status"], "ok")
        self.assertLess(np.abs(np.array(self.json()["two_view"]["pose"]["rotation"]) - np.eye(3)).max(), 0.05)

    def test_ground_truth_adds_errors(self):
        self.match("a.pgm", "b.pgm", "--ground-truth", "H.txt", "--json", "out.json", prints="corner error")
        out = self.json()
        self.assertLess(out["corner_error"], 0.5)
        final = out["stages"][3]
        self.assertGreater(final["precision_3px"], 0.99)
        self.assertLess(final["reprojection_error"]["rms"], 1.0)

    def test_json_is_consistent_from_stage_to_stage(self):
        self.match("a.pgm", "b.pgm", "--json", "out.json", "--T_w", "0.7")
        out = self.json()
        self.assertEqual([s["name"] for s in out["stages"]], ["knn", "tf", "gms", "prosac"])
        self.assertEqual(out["stages"][0]["input"], out["target"]["keypoints"])
        for before, after in zip(out["stages"], out["stages"][1:]):
            self.assertEqual(after["input"], before["output"])
            self.assertLessEqual(after["output"], after["input"])
        self.assertEqual(out["status"], "ok")
        self.assertEqual(out["stages"][3]["output"], out["inliers"])
        self.assertEqual(out["options"]["T_w"], 0.7)
        x, y, w = (h[0] * 160 + h[1] * 120 + h[2] for h in out["homography"])
        self.assertAlmostEqual(x / w, 160 + 7, delta=0.5)
        self.assertAlmostEqual(y / w, 120 - 4, delta=0.5)
        self.assertNotIn("corner_error", out)

    def test_csv_has_every_neighbour_with_its_level(self):
        self.match("a.pgm", "b.pgm", "--json", "out.json", "--csv", "out.csv", "--ground-truth",
                   "H.txt")
        out = self.json()
        rows = self.table()
        levels = [row["level"] for row in rows]
        self.assertEqual(len(rows), out["stages"][0]["output"])
        self.assertEqual(levels.count("ktgp"), out["inliers"])
        for row in rows:
            dx = float(row["target_x"]) - float(row["reference_x"]) - 7
            dy = float(row["target_y"]) - float(row["reference_y"]) + 4
            self.assertAlmostEqual(float(row["reprojection_error"]), (dx * dx + dy * dy) ** 0.5,
                                   delta=1e-2)
            if row["level"] != "knn":
                self.assertLess(float(row["ratio"]), 0.66)

    def test_csv_has_all_final_matches(self):
        self.match_photos("a.pgm", "b.pgm", "--json", "out.json", "--csv", "out.csv", "--ground-truth", "H.txt")
        final = [row for row in self.table() if row["level"] in ("ktgp", "guided")]
        self.assertEqual(len(final), self.json()["inliers"])
        self.assertIn("guided", {row["level"] for row in final})
        for row in final:
            self.assertLess(float(row["reprojection_error"]), 4.0)

    def test_pictures_are_written(self):
        names = {"--draw": "overlay.png", "--draw-stages": "stages.jpg", "--draw-final": "f.png"}
        self.match("a.pgm", "b.pgm", *[x for pair in names.items() for x in pair])
        for name in names.values():
            self.assertGreater((self.folder / name).stat().st_size, 1000)

    def test_thresholds_reach_the_stages(self):
        def outputs(*options, **expected):
            self.match("a.pgm", "b.pgm", "--json", "out.json", *options, **expected)
            out = self.json()
            return out["target"]["keypoints"], *[s["output"] for s in out["stages"]]

        usual = outputs()
        self.assertLess(outputs("--features", "100")[0], usual[0])
        self.assertLess(outputs("--fast_threshold", "120")[0], usual[0])
        self.assertLess(outputs("--levels", "1")[0], usual[0])
        self.assertEqual(outputs("--descriptor", "teblid")[0], usual[0])
        self.assertNotEqual(outputs("--descriptor", "teblid"), usual)
        self.assertNotEqual(outputs("--distribution", "uniform", "--features", "300"),
                            outputs("--features", "300"))
        self.assertLess(outputs("--T_w", "0.2")[2], usual[2])
        self.assertLess(outputs("--T_G", "20", code=1)[3], usual[3])
        self.assertLess(outputs("--prosac_threshold", "0.3")[4], usual[4])

    def test_images_that_do_not_match_give_exit_code_1(self):
        write_pgm(self.folder / "other.pgm", picture(seed=2))
        self.match("a.pgm", "other.pgm", "--json", "out.json", "--ground-truth", "H.txt", code=1,
                   prints="no homography")
        out = self.json()
        self.assertIsNone(out["homography"])
        self.assertNotEqual(out["status"], "ok")

    def test_an_image_without_features_is_no_crash(self):
        write_pgm(self.folder / "grey.pgm", np.full((HEIGHT, WIDTH), 90, np.uint8))
        for pair in (("grey.pgm", "b.pgm"), ("a.pgm", "grey.pgm"), ("grey.pgm", "grey.pgm")):
            self.match(*pair, "--csv", "out.csv", "--json", "out.json", "--draw", "o.png", code=1,
                       prints="too_few_features")

    def test_unusable_files_are_named(self):
        self.write("text.png", "not an image")
        self.write("eight.txt", "1 0 0 0 1 0 0 0")
        self.write("word.txt", "1 0 0 0 1 0 0 0 one")
        self.write("flat.txt", "0 0 0 0 0 0 0 0 0")
        for arguments, name in (
                (("missing.png", "b.pgm"), "missing.png"),
                (("a.pgm", "text.png"), "text.png"),
                (("a.pgm", "b.pgm", "--ground-truth", "missing.txt"), "missing.txt"),
                (("a.pgm", "b.pgm", "--ground-truth", "eight.txt"), "eight.txt"),
                (("a.pgm", "b.pgm", "--ground-truth", "word.txt"), "word.txt"),
                (("a.pgm", "b.pgm", "--ground-truth", "flat.txt"), "flat.txt"),
                (("a.pgm", "b.pgm", "--json", "no/such/folder.json"), "no/such/folder.json"),
                (("a.pgm", "b.pgm", "--draw", "overlay.nope"), "overlay.nope")):
            run = self.match(*arguments, code=2, words=name)
            self.assertEqual(run.stderr.count("\n"), 1, run.stderr)

    def test_pages_that_are_not_used_are_counted(self):
        grey = window(picture(), 20, 20)
        for order in "<>":
            for big in (False, True):
                for kinds, pages in (((0,), 1), ((0, 0, 2), 3), ((0, 1, 1), 1), ((2, 1, 4, 2), 2)):
                    with self.subTest(order=order, big=big, kinds=kinds):
                        write_tiff(self.folder / "a.tiff", grey, kinds, order, big)
                        text = self.match("a.tiff", "b.pgm").stderr
                        self.assertEqual(text, "" if pages == 1 else
                                         f"ktgp_match: a.tiff: has {pages} pages; only the first is used\n")
        content = (self.folder / "a.tiff").read_bytes()  # its last page begins a circle
        first = struct.unpack(order + "Q", content[8:16])[0]
        (self.folder / "a.tiff").write_bytes(content[:-8] + struct.pack(order + "Q", first))
        self.assertIn("has 2 pages", self.match("a.tiff", "b.pgm", code=None).stderr)

    def test_thresholds_out_of_range_are_refused_with_the_range(self):
        for option, value, expected in (("--T_w", "1.5", "[0, 1]"),
                                        ("--T_w", "nan", "[0, 1]"),
                                        ("--T_G", "-1", "[0, 40]"),
                                        ("--features", "0", "[100, 20000]"),
                                        ("--levels", "17", "[1, 16]"),
                                        ("--scale_factor", "1", "2]"),
                                        ("--scale_factor", "2.5", "2]"),
                                        ("--fast_threshold", "256", "[1, 255]"),
                                        ("--threads", "-1", "[0, 256]"),
                                        ("--prosac_threshold", "0", "[0.1, 20]"),
                                        ("--descriptor", "sift", "teblid"),
                                        ("--distribution", "even", "uniform"),
                                        ("--features", "many", "a whole number")):
            self.match("a.pgm", "b.pgm", f"{option}={value}", code=2, words=(option, expected))

    def options(self, *arguments):
        self.match("a.pgm", "b.pgm", "--json", "out.json", *arguments)
        return self.json()["options"]

    def test_parameters_come_from_the_files_that_ros_writes(self):
        self.write("flat.yaml",
            "T_w: 0.71\ngms_rotation: true\nimage_transport: raw\nmatches_image: {jpeg: 80}\n"
            "max_reference_age: 2\n")
        self.write("below.yaml", "camera:\n  matcher: {T_w: 0.71}\n")
        self.write("dynparam.yaml",
            "!!python/object/new:dynamic_reconfigure.encoding.Config\n"
            "dictitems:\n  T_w: 0.71\n  descriptor: teblid\n"
            "  groups: !!python/object/new:dynamic_reconfigure.encoding.Config\n"
            "    dictitems: {id: 0}\n    state: []\n"
            "state: []\n")
        for file in ("flat.yaml", "below.yaml", "dynparam.yaml"):
            self.assertEqual(self.options("--params", file)["T_w"], 0.71, file)
        self.assertIs(self.options("--params", "flat.yaml")["gms_rotation"], True)
        self.assertEqual(self.options("--params", "dynparam.yaml")["descriptor"], "teblid")

    def test_the_parameters_may_come_from_a_pipe(self):
        run = subprocess.run([TOOLS / "ktgp_match", "a.pgm", "b.pgm", "--params", "/dev/stdin", "--json", "out.json"],
                             cwd=self.folder, input="T_w: 0.71\n", text=True, stdout=subprocess.DEVNULL, timeout=60)
        self.assertEqual(run.returncode, 0)
        self.assertEqual(self.json()["options"]["T_w"], 0.71)

    def test_the_command_line_counts_before_the_file_and_the_file_before_the_preset(self):
        self.write("p.yaml", "T_w: 0.71\nmutual: false\n")
        robust = self.options("--preset", "robust")
        self.assertIs(robust["mutual"], True)
        both = self.options("--preset", "robust", "--params", "p.yaml", "--T_w", "0.6")
        self.assertIs(both["mutual"], False)
        self.assertEqual(both["T_w"], 0.6)
        self.assertIs(self.options("--preset", "robust", "--mutual=false")["mutual"], False)
        self.assertIs(self.options("--gms_scale", "true")["gms_scale"], True)
        self.run_tool("ktgp_match", "a.pgm", "b.pgm", "--json", "photo.json")
        photo = self.json("photo.json")["options"]
        self.assertEqual(photo, self.options("--preset", "photo"))

    def test_the_ratio_threshold_is_the_descriptors_unless_it_is_set(self):
        self.write("usual.yaml", "T_G: 6.0\n")  # without --preset: the node's defaults
        usual = "--params", "usual.yaml"
        self.assertEqual(self.options("--descriptor", "teblid", *usual)["T_w"], 0.8)
        self.assertEqual(self.options("--preset", "teblid")["T_w"], 0.8)
        self.assertEqual(self.options("--descriptor", "orb", *usual)["T_w"], 0.66)
        self.assertEqual(self.options("--descriptor", "teblid", "--T_w", "0.7", *usual)["T_w"], 0.7)
        robust = self.options("--preset", "robust", "--descriptor", "teblid")
        self.assertEqual(robust["T_w"], 1.0)
        self.write("t.yaml", "descriptor: teblid\n")
        self.assertEqual(self.options("--params", "t.yaml")["T_w"], 0.8)

    def test_errors_in_a_parameter_file_are_named(self):
        for text, expected in (("T_W: 0.7\n", "no parameter T_W"), ("T_w: 2\n", "[0, 1]"),
                               ("T_w: .nan\n", "[0, 1]"), ("T_w: [1]\n", "T_w"),
                               ("features: 10.5\n", "whole number"),
                               ("features: 2000.0\n", "whole number"), ('T_w: "0.7"\n', "without quotes"), ("T_w: {\n",
                                                                                                            "bad.yaml"),
                               ("descriptor: slow\n", "teblid"), ("extractor: opencv\n", "no parameter extractor"), ("",
                                                                                                              "name: value"),
                               ("&a {b: *a}\n", "too deep"),  # a map that contains itself
                               ("&a {dictitems: *a}\n", "too deep"),
                               ("T_w: 0.7\nviews: 5\nT_w: 0.8\n", "T_w occurs twice; expected it once"),
                               ("{dictitems: {T_w: 0.7}, dictitems: {T_w: 0.8}}\n", "dictitems occurs twice"),
                               ("T_w: 0.7\n---\nT_w: 0.8\n", "has 2 YAML documents; expected one"),
                               ("T_w:\nT_G: 6.0\n", "T_w is empty; expected a value"),
                               ("# nothing\n", "sets no parameter"), ("{}\n", "sets no parameter"),
                               ("camera: {matcher: {}}\n", "sets no parameter")):
            self.write("bad.yaml", text)
            self.match("a.pgm", "b.pgm", "--params", "bad.yaml", code=2, words=("bad.yaml", expected))
        self.match("a.pgm", "b.pgm", "--params", "none.yaml", code=2, words="none.yaml")
        self.match("a.pgm", "b.pgm", "--preset", "best", code=2, words="ktgp, photo, robust, slam, teblid, video")

    def test_a_file_of_several_nodes_is_refused(self):
        """As rosparam dump writes it of the namespace of a camera."""
        two = "matcher: {T_w: 0.71}\n%sstabilizer: {lag: 3}\n"
        indented = "camera:\n" + "".join("  " + line + "\n" for line in (two % "").splitlines())
        for text, names in ((two % "", "matcher and of stabilizer"), (indented, "matcher and of stabilizer"),
                            (two % "image_transport: raw\n", "matcher and of stabilizer"),
                            ("image_transport: raw\n" "matcher: {T_w: 0.71}\n", "matcher"),
                            ("left: {matcher: {T_w: 0.7}}\nright: {matcher: {T_w: 0.8}}\n", "left and of right")):
            self.write("two.yaml", text)
            self.match("a.pgm", "b.pgm", "--params", "two.yaml", code=2, words=(
                f"two.yaml: holds the parameters of {names}; expected those of one node alone, as `rosparam dump"))

    def test_an_argument_in_a_parameter_file_is_refused_with_the_option(self):
        for line, option in (("preset: robust", "--preset robust"), ("params: other.yaml", "--params other.yaml")):
            self.write("p.yaml", "T_w: 0.71\n" + line + "\n")
            self.match("a.pgm", "b.pgm", "--params", "p.yaml", code=2,
                       words=f"p.yaml: {line.split(':')[0]} is an argument, not a parameter; expected {option}")

    def test_an_empty_name_is_refused(self):
        """As of a variable of a script that is not set."""
        for option in ("--json", "--csv", "--draw", "--draw-stages", "--draw-final", "--params", "--ground-truth"):
            for arguments in ((option, ""), (option + "=",)):
                self.match("a.pgm", "b.pgm", *arguments, code=2, words=f"{option} is empty; expected a file")
        self.match("a.pgm", "b.pgm", "--preset", "", code=2, words="--preset is empty; expected a name")
        self.match("", "b.pgm", code=2, words="A is empty; expected a file")
        self.match("a.pgm", "", code=2, words="B is empty; expected a file")

    def test_a_parameter_file_has_at_most_16_maps_around_the_parameters_and_a_megabyte(self):
        for maps, rest, expected in ((16, 0, ""), (17, 0, "nested too deeply"), (0, 1 << 20, ""),
                                     (0, (1 << 20) + 1, "longer than 1 MB")):
            text = maps * "{a: " + "{T_w: 0.61}" + maps * "}" + "\n"
            self.write("p.yaml", text + "#" * (rest - len(text)))
            with self.subTest(maps=maps, size=rest):
                if expected:
                    self.match("a.pgm", "b.pgm", "--params", "p.yaml", code=2, words=("p.yaml", expected))
                else:
                    self.assertEqual(self.options("--params", "p.yaml")["T_w"], 0.61)

    def test_help_says_defaults_ranges_and_examples(self):
        run = self.match("--help")
        for text in ("Examples:", "--T_w", "[0, 1]", "--preset NAME", "Preset photo, the default", "Exit code",
                     "--help-all"):
            self.assertIn(text, run.stdout)
        self.assertNotIn("--fast_threshold", run.stdout)
        self.match("--help-all", prints="--fast_threshold")
        self.match("a.pgm", "b.pgm", "--fast_threshold", "30")

    def test_a_closed_pipe_leaves_no_half_file(self):
        process = subprocess.Popen([TOOLS / "ktgp_match", "a.pgm", "b.pgm", "--csv", "-", "--draw", "o.png"],
                                   cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        process.stdout.close()
        self.assertIn("standard output cannot be written", process.stderr.read())
        process.stderr.close()
        self.assertEqual(process.wait(), 2)
        self.assertTrue((self.folder / "o.png").exists())
        self.assertEqual([path for path in self.folder.iterdir() if "unfinished" in path.name], [])

    def test_missing_argument(self):
        self.match("a.pgm", code=2, words="B is required")

    def test_same_input_same_output(self):
        for name in ("1.csv", "2.csv"):
            self.match("a.pgm", "b.pgm", "--csv", name, "--threads", name[0])
        self.assertEqual((self.folder / "1.csv").read_bytes(),
                         (self.folder / "2.csv").read_bytes())
