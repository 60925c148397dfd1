"""Runs ktgp_find as a program."""
import os
import shutil
import zlib

import cv2
import numpy as np
from tool_case import HEIGHT, WIDTH, ToolCase, corners_off, mapped, picture, shift, window, write_pgm, write_tiff


def png_of_palette(grey, is_shown):
    """A PNG of 128 grey levels, each in the palette twice: opaque and transparent. The opacities come after a comment
    of 9 kB."""
    def chunk(name, data):
        return len(data).to_bytes(4, "big") + name + data + zlib.crc32(name + data).to_bytes(4, "big")

    height, width = grey.shape
    indices = np.where(is_shown, grey // 2, 128 + grey // 2).astype(np.uint8)
    header = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 3, 0, 0, 0])
    levels = np.repeat(np.tile(np.arange(0, 256, 2, dtype=np.uint8), 2), 3)
    chunks = ((b"IHDR", header), (b"tEXt", b"Comment\0" + 9000 * b"x"), (b"PLTE", levels.tobytes()),
              (b"tRNS", 128 * b"\xff" + 128 * b"\0"),
              (b"IDAT", zlib.compress(np.pad(indices, ((0, 0), (1, 0))).tobytes())), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*each) for each in chunks)


class KtgpFind(ToolCase):
    def setUp(self):
        super().setUp()
        (self.folder / "posters").mkdir()
        for number in range(3):
            write_pgm(self.folder / "posters" / f"poster{number}.pgm", picture(number + 1), 20, 20)
        write_pgm(self.folder / "scene.pgm", picture(2), 13, 24)  # poster1 moved by (7, -4)

    def find(self, *arguments, **expected):
        return self.run_tool("ktgp_find", "--force", *arguments, **expected)

    def detections(self):
        return self.json()["detections"]

    def test_finds_a_target_of_a_folder(self):
        run = self.find("scene.pgm", "posters", "--json", "out.json", "--draw", "out.png", prints="poster1 0: ok")
        self.assertEqual(run.stderr, "")
        found, = self.detections()
        self.assertEqual((found["id"], found["instance"], found["status"]), ("poster1", 0, "ok"))
        expected = [(7, -4), (WIDTH + 6, -4), (WIDTH + 6, HEIGHT - 5), (7, HEIGHT - 5)]
        for (x, y), (right_x, right_y) in zip(found["corners"], expected):
            self.assertAlmostEqual(x, right_x, delta=0.3)
            self.assertAlmostEqual(y, right_y, delta=0.3)
        self.assertGreater((self.folder / "out.png").stat().st_size, 1000)

    def test_more_than_one_image_is_counted(self):
        self.find("scene.pgm", "other.pgm", "posters", code=2, words="expected IMAGE and TARGETS, but 3 names came\n")

    def test_pictures_of_colours_are_drawn_in_colour(self):
        grey = cv2.imread(self.path("scene.pgm"), cv2.IMREAD_GRAYSCALE)
        self.assertTrue(cv2.imwrite(self.path("scene.png"), cv2.merge([grey, grey, grey // 2])))
        self.find("scene.png", "posters", "--draw", "drawn.png")
        drawn = cv2.imread(self.path("drawn.png")).astype(int)
        self.assertGreater(np.median(abs(drawn[:, :, 0] - drawn[:, :, 2])), 30)

    def test_a_number_that_is_not_whole_is_called_so(self):
        for value, words in (("2000.0", "2000.0 is not a whole number"), ("many", "many is not a number"),
                             ("99", "99 is out of range; expected a whole number in [100, 100000]")):
            self.find("scene.pgm", "posters", "--features", value, code=2, words=words)

    def test_pages_that_are_not_used_are_counted(self):
        write_tiff(self.folder / "scene.tiff", window(picture(2), 13, 24), (0, 0))
        write_tiff(self.folder / "posters/last.tiff", window(picture(5), 20, 20), (0, 0, 0))
        run = self.find("scene.tiff", "posters", prints="poster1 0: ok")
        self.assertEqual(run.stderr, "ktgp_find: scene.tiff: has 2 pages; only the first is used\n"
                         f"ktgp_find: {os.path.realpath(self.path('posters/last.tiff'))}: has 3 pages; only the first is used\n")

    def test_a_camera_gives_the_poses(self):
        f = 300.0
        camera = f"{f},{f},159.5,119.5"
        self.find("scene.pgm", "posters", "--camera", camera, "--json", "out.json")
        found, = self.detections()
        self.assertAlmostEqual(found["poses"][0]["translation"][2], f / WIDTH, delta=0.02)  # in its widths
        self.assertAlmostEqual(found["poses"][0]["translation"][0], 7.0 / WIDTH, delta=0.005)
        self.assertEqual(len(found["poses"][0]["covariance"]), 36)
        self.find("scene.pgm", "posters", "--camera", camera, prints=("pose (share", "widths of the target"))
        self.write("list.yaml", "- {image: posters/poster1.pgm, width: 0.8}\n")
        self.find("scene.pgm", "list.yaml", "--camera", camera, "--json", "out.json")
        self.assertAlmostEqual(self.detections()[0]["poses"][0]["translation"][2], 0.8 * f / WIDTH, delta=0.02)
        for wrong, words in (("1,1,0,0", "fx of --camera is 1; expected a focal length in [48, 16000]"),
                             ("300,300,900,100", "outside the image of 320x240")):
            self.find("scene.pgm", "posters", "--camera", wrong, code=2, words=words)

    def test_transparent_pixels_are_not_part_of_a_target(self):
        """A round sign on a transparent ground, with another picture under it."""
        sign, under = (window(picture(seed))[:200, :200] for seed in (21, 22))
        y, x = np.mgrid[:200, :200]
        (self.folder / "signs").mkdir()
        for radius in (95, 70):
            disc = np.hypot(x - 99.5, y - 99.5) < radius
            pixels = np.where(disc, sign, under)
            opacity = np.where(disc, 255, 0).astype(np.uint8)
            cv2.imwrite(self.path("signs", "sign.png"), np.dstack([pixels] * 3 + [opacity]))
            shift = np.array([[0.9, -0.15, 70], [0.15, 0.9, 20.0]])
            scene = window(picture(23)).copy()
            seen = cv2.warpAffine(opacity, shift, (WIDTH, HEIGHT)) > 128
            scene[seen] = cv2.warpAffine(sign, shift, (WIDTH, HEIGHT))[seen]
            cv2.imwrite(self.path("scene.png"), scene)
            self.find("scene.png", "signs", "--json", "out.json")
            found, = self.detections()
            truth = cv2.transform(np.array([[[0.0, 0], [199, 0], [199, 199], [0, 199]]]), shift)[0]
            np.testing.assert_allclose(found["corners"], truth, atol=1.5, err_msg=str(radius))
            scene = window(picture(23)).copy()
            scene[20:220, 60:260] = under
            cv2.imwrite(self.path("scene.png"), scene)
            self.find("scene.png", "signs", code=1, prints="none found")

    def test_transparent_colours_of_a_palette_are_not_part_of_a_target(self):
        """Found as in the file of the same pixels with an opacity each."""
        sign, under = (window(picture(seed))[:200, :200] for seed in (21, 22))
        y, x = np.mgrid[:200, :200]
        disc = np.hypot(x - 99.5, y - 99.5) < 70
        levels = np.where(disc, sign, under) // 2 * 2
        scene = window(picture(23))
        for name, shown in (("with_sign.png", np.where(disc, sign, scene[20:220, 60:260])), ("with_under.png", under)):
            pasted = scene.copy()
            pasted[20:220, 60:260] = shown
            cv2.imwrite(self.path(name), pasted)
        palette = png_of_palette(levels, disc)
        self.assertGreater(palette.index(b"tRNS"), 2 * 4096)
        opacity = np.where(disc, 255, 0).astype(np.uint8)
        found = []
        (self.folder / "signs").mkdir()
        for content in (palette, cv2.imencode(".png", np.dstack([levels] * 3 + [opacity]))[1].tobytes()):
            (self.folder / "signs" / "sign.png").write_bytes(content)
            self.find("with_under.png", "signs", code=1, prints="none found")
            self.find("with_sign.png", "signs", "--json", "out.json")
            found.append(self.detections())
        (first,), second = found
        np.testing.assert_allclose(first["corners"], [(60, 20), (259, 20), (259, 219), (60, 219)], atol=1.0)
        self.assertEqual([first], second)

    def test_a_target_that_is_transparent_everywhere_is_refused(self):
        cv2.imwrite(self.path("posters", "glass.png"), np.dstack([window(picture(8))] * 3 + [np.zeros_like(window(picture(8)))]))
        self.find("scene.pgm", "posters", words="glass.png: is transparent everywhere; expected a picture")

    def test_reads_a_list(self):
        self.write(
            "list.yaml",
            "- {id: map, images: [posters/poster0.pgm, posters/poster1.pgm], width: 0.8, frame: wall}\n"
            "- {image: posters/poster2.pgm}\n")
        self.find("scene.pgm", "list.yaml", "--json", "out.json")
        found, = self.detections()
        self.assertEqual([found[name] for name in ("id", "image", "width", "frame")],
                         ["map", 1, 0.8, "wall"])

    def test_an_empty_frame_is_none(self):
        for value, frame in (("", ""), ("~", ""), ('"null"', "null")):
            self.write("list.yaml", f"- {{image: posters/poster1.pgm, frame: {value}}}\n")
            self.find("scene.pgm", "list.yaml", "--json", "out.json")
            found, = self.detections()
            self.assertEqual(found["frame"], frame)

    def test_no_file_that_is_read_is_written(self):
        self.write("list.yaml", "- {image: posters/poster1.pgm}\n")
        files = ("list.yaml", "scene.pgm", "posters/poster1.pgm")
        before = [(self.folder / name).read_bytes() for name in files]
        for name, words in zip(files, ("file of TARGETS and --json", "file of IMAGE and --json", "input")):
            self.find("scene.pgm", "list.yaml", "--json", name, code=2, words=f"{name}: is the {words}")
        self.assertEqual([(self.folder / name).read_bytes() for name in files], before)

    def test_strange_ids_forge_nothing_and_long_ones_are_refused(self):
        self.write("list.yaml",
                   '- {id: "a\\n[FATAL] battery\\e[31m", image: posters/poster1.pgm}\n' f'- {{id: {300 * "x"}, image: posters/poster2.pgm}}\n')
        run = self.find("scene.pgm", "list.yaml", "--json", "out.json", prints="a\\x0a[FATAL] battery\\x1b[31m 0: ok")
        self.assertEqual(self.detections()[0]["id"], "a\n[FATAL] battery\x1b[31m")
        self.assertIn(f'target "{200 * "x"}...": the id has 300 bytes; expected at most 256', run.stderr)

    def test_names_refused_targets_and_searches_the_others(self):
        self.write("posters/broken.png", "no image")
        shutil.copy(self.folder / "posters" / "poster1.pgm", self.folder / "posters" / "copy.pgm")
        (self.folder / "posters" / "grey.pgm").write_bytes(b"P5\n99 99\n255\n" + bytes(99 * 99))
        self.find("scene.pgm", "posters", prints="known targets: 3, of these with similar keypoints: ",
                  words=("broken.png: cannot be read", 'shows the same as target "copy"', "too little texture"))

    def test_narrow_images_are_refused_by_their_shape(self):
        (self.folder / "posters" / "line.pgm").write_bytes(b"P5\n3 900\n255\n" + bytes(i % 251 for i in range(2700)))
        self.find("scene.pgm", "posters",
                  words='target "line": image 1 is too narrow: 3x900 px (made smaller: 1x400) with 0 keypoints')

    def test_a_refused_target_says_where_it_is_from(self):
        self.write("list.yaml",
            "- {id: a, image: posters/poster1.pgm}\n- {id: b, image: nope.png}\n"
            "- {id: a, image: posters/poster2.pgm}\n")
        run = self.find("scene.pgm", "list.yaml")
        self.assertEqual(run.stderr.splitlines(), [
            f'ktgp_find: list.yaml, line 2: target "b": {self.folder.resolve()}/nope.png: is missing',
            'ktgp_find: list.yaml, line 3: target "a" exists already; expected a new id'])
        write_pgm(self.folder / "posters" / "poster1.png", picture(9))
        run = self.find("scene.pgm", "posters")
        self.assertEqual(run.stderr, 'ktgp_find: posters/poster1.png: target "poster1" exists already; '
                                     'expected a new id\n')

    def test_says_that_a_target_looks_like_itself_in_another_pose(self):
        half = window(picture(5))[:HEIGHT // 2]
        card = np.vstack([half, half[::-1, ::-1]])
        write_pgm(self.folder / "posters" / "card.pgm", card)
        # At half size: in views where both poses match equally well, it may be missed.
        small = card.reshape(HEIGHT // 2, 2, WIDTH // 2, 2).sum(axis=(1, 3)) // 4
        write_pgm(self.folder / "table.pgm", np.pad(small.astype(np.uint8), ((60,), (80,)), constant_values=128))
        self.find("table.pgm", "posters", "--json", "out.json",
                  prints="; it looks the same turned by 180 degrees: this pose is one of several\n")
        self.assertEqual({found["ambiguity"] for found in self.detections()}, {"turned by 180 degrees"})
        run = self.find("scene.pgm", "posters", "--json", "out.json")
        self.assertNotIn("looks the same", run.stdout)
        self.assertEqual([found["ambiguity"] for found in self.detections()], [""])

    def test_says_that_there_may_be_more_copies(self):
        poster = np.pad(window(picture(2), 20, 20), ((0, 0), (0, 20)), constant_values=128)
        cv2.imwrite(self.path("copies.pgm"), np.tile(poster, 3))
        run = self.find("copies.pgm", "posters", "--max-instances", "2", "--json", "out.json")
        self.assertEqual(len(self.detections()), 2)
        self.assertIn("\n2 of poster1 were found; there may be more: --max-instances\n", run.stdout)
        self.assertEqual(self.json()["at_limit"], "poster1")
        run = self.find("copies.pgm", "posters", "--json", "out.json")
        self.assertEqual(len(self.detections()), 3)
        self.assertNotIn("there may be more", run.stdout)

    def test_other_files_and_folders_do_not_count(self):
        self.write("posters/notes.txt", "not an image")
        (self.folder / "posters" / "old").mkdir()
        write_pgm(self.folder / "posters" / "old" / "poster9.pgm", picture(9), 20, 20)
        (self.folder / "posters" / "old.png").mkdir()
        run = self.find("scene.pgm", "posters", prints="known targets: 3, of these with similar keypoints: ")
        self.assertEqual(run.stderr, "")

    def test_nothing_found_is_exit_code_1_and_said_with_what_to_try(self):
        write_pgm(self.folder / "other.pgm", picture(9))
        self.find("other.pgm", "posters", code=1,
                  prints=("none found. For small or distant targets try: --features 8000 --target-features 2000",
                          "tilted by 60 degrees or more: ktgp_match with the target's image and this one\n"))
        self.assertNotIn("try:", self.find("other.pgm", "posters", "--features", "8000", code=1).stdout)

    def test_a_page_that_is_tilted_by_65_degrees_is_found_by_both_programs(self):
        f, width, height = 768.0, 640, 480
        K = np.array([[f, 0, width / 2], [0, f, height / 2], [0, 0, 1]])
        turn = cv2.Rodrigues(np.array([0, np.radians(65), 0]))[0]
        distance = f * WIDTH / (0.5 * width)  # from the front the page is half as wide as the image
        H = K @ np.column_stack([turn[:, 0], turn[:, 1], (0, 0, distance)]) @ shift(-WIDTH / 2, -HEIGHT / 2)
        # Drawn three times as large and averaged, as a camera sees it.
        large = cv2.warpPerspective(window(picture(2), 20, 20), np.diag([3.0, 3.0, 1.0]) @ H, (3 * width, 3 * height),
                                    borderValue=128)
        cv2.imwrite(self.path("page.png"), cv2.resize(large, (width, height), interpolation=cv2.INTER_AREA))
        self.find("page.png", "posters", "--json", "out.json")
        found, = self.detections()
        self.assertEqual((found["id"], found["status"]), ("poster1", "ok"))
        corners = mapped(H, [(0, 0), (WIDTH - 1, 0), (WIDTH - 1, HEIGHT - 1), (0, HEIGHT - 1)])
        np.testing.assert_allclose(found["corners"], corners, atol=1.5)
        self.run_tool("ktgp_match", "posters/poster1.pgm", "page.png", "--json", "out.json", "--force")
        off = corners_off(self.json()["homography"], H, (WIDTH, HEIGHT))
        self.assertLess(abs(off).max(), 1.5)

    def test_only_doubtful_targets_are_nothing_found(self):
        """Two pictures with the same logo: where they have the same support, neither is there."""
        def write_scene(name, logo, width, height, left, top):
            scene = np.full((height, width), 128, np.uint8)
            scene[top:top + 80, left:left + 80] = logo[:80, :80]
            cv2.imwrite(self.path(name), scene)
        (self.folder / "logos").mkdir()
        doubtful = 0
        for seed in range(40):
            logo = picture(seed)
            write_scene("logos/a.pgm", logo, 240, 240, 20, 20)
            write_scene("logos/b.pgm", logo, 360, 360, 20, 20)
            write_scene("scene.pgm", logo, 640, 480, 250, 200)
            run = self.find("scene.pgm", "logos", "--json", "out.json", code=None)
            states = {found["status"] for found in self.detections()}
            self.assertEqual(run.returncode, 0 if "ok" in states else 1, (seed, states))
            doubtful += states == {"model_rejected"}
            if doubtful:
                break
        self.assertTrue(doubtful, "no scene of this kind")

    def test_unusable_lists_are_refused_with_the_reason(self):
        (self.folder / "empty").mkdir()
        lists = {"a.yaml": ("{", "cannot be read as YAML"), "b.yaml": ("x: 1", "no list"),
                 "c.yaml": ("- {id: a}", "line 1: it has no image"),
                 "d.yaml": ("- {id: a, image: b, colour: c}", "\"colour\" is unknown"),
                 "e.yaml": ("- {id: a, image: b}\n- {images: t0.png}", "line 2: images is no list of files"),
                 "f.yaml": ("- {image: b, width: wide}", "line 1: width is no number of metres"),
                 "g.yaml": ("- {id: a, id: b, image: c}", "\"id\" occurs twice"),
                 "i.yaml": ("- {image: b, images: [c, d]}", "line 1: it has image and images; expected one of them"),
                 "j.yaml": ("- {id: a, image: ''}", "line 1: the name of an image is empty"),
                 "k.yaml": ("- {id: , image: b}", "line 1: id is empty; expected a name"),
                 "l.yaml": ("- {id: a, image: }", "line 1: image is empty; expected the name of a file"),
                 "m.yaml": ("- {id: a, images: [b, ~]}", "line 1: a name in images is empty; expected a file"),
                 "h.yaml": ("- {image: b}\n---\n- {image: c}", "several YAML documents"),
                 "\x1b[31m.yaml": ("x: 1", "\\x1b[31m.yaml: is no list")}
        for name, (text, _) in lists.items():
            self.write(name, text)
        os.mkfifo(self.folder / "pipe")
        lists.update({"missing": (None, f"is missing; expected a folder or a YAML list; it was looked for in "
                                  f"{self.folder}"), "empty": (None, "without images"),
                      "pipe": (None, "neither a folder nor a file"),
                      "scene.pgm": (None, "is a picture; expected a folder of pictures")})
        for name, (_, reason) in lists.items():
            self.find("scene.pgm", name, code=2, words=reason)

    def test_a_video_is_named_with_the_program_that_reads_it(self):
        for name, begin in (("a.mp4", b"\0\0\0\x20ftypisom"), ("b.mkv", b"\x1a\x45\xdf\xa3"),
                            ("c.avi", b"RIFF\0\0\0\0AVI LIST")):
            (self.folder / name).write_bytes(begin + bytes(1000))
            self.find(name, "posters", code=2, words="is a video; ktgp_bag matches a video that is given alone, and finds targets in it")
