"""The cases: command lines of the program, run one after another in an empty folder per case.

A step is a command line without the program's name. `# code N` at its end states the expected exit code (default 0).
"""

from dataclasses import dataclass, field

import inputs as i

# Outputs that are not recorded, each with the reason.
UNRECORDED = {".cache/*": "how fast the machine is",
              "*catalogue.db*": "the index of sessions (SQLite), with times; `catalogue list` shows its content"}


@dataclass
class Case:
    name: str
    inputs: dict
    steps: list
    # Glob patterns of outputs that are compared within rounding on every machine, each with the reason.
    within_rounding: dict = field(default_factory=dict)


CASES = [
    Case("polarization", {"bench.toml": i.BENCH, "film.toml": i.FILM_BENCH, "shifted.toml": i.SHIFTED_BENCH}, [
        "sim render --bench bench.toml --angles-deg 0,30,60,90,120,150 --out session",
        "sim render --bench film.toml --angles-deg 0,22.5,45,67.5,90,112.5,135,157.5 --out filmed",
        "sim render --bench shifted.toml --out shifted",
        "sim render --sample logo --size 32 --seed 3 --retardance-deg 5 --angles-deg 0,60,120 --out logo",
        "reconstruct polarization session --out auto",
        "reconstruct polarization session --out plain --model plain",
        "reconstruct polarization session --out sinusoid --model sinusoid --smooth strong --smooth-maps --smoothed-exr",
        "reconstruct polarization session --out prenormalized --model prenormalized --offset-deg 12.5 --smooth none",
        "reconstruct polarization session --out circle --model circle --oblique auto --max-error 0.0001 # code 1",
        "reconstruct polarization session --out relative --model sinusoid --relative-period 0.7,2",
        "reconstruct polarization session --out contrast --model sinusoid --contrast-period 0.6,1.5 --depth-um 0.1",
        "reconstruct polarization filmed --out curve --model curve",
        "reconstruct polarization filmed --out filmed-auto --model auto --oblique auto",
        "reconstruct polarization shifted --out aligned --model sinusoid",
        "reconstruct polarization shifted --out unaligned --model sinusoid --align off",
    ]),
    Case("demo", {}, ["demo --size 64 --seed 3 --angles-deg 0,45,90,135 --out demo"]),
    Case("import", {
        **{f"photos/{angle:03}.png": i.lazy(i.analysed, k) for k, angle in enumerate((0, 45, 90, 135))},
        **{f"colour/{angle}.png": i.lazy(i.analysed, k, True) for k, angle in enumerate((0, 45, 90, 135))},
        **{f"bracket/{k}.png": i.lazy(i.bracket, 8 * time, i.exif(time, 400, 200)) for k, time in enumerate((1, 2, 4))},
        "raw/frame.png": i.lazy(i.sensor),
    }, [
        "import photos --out series",
        "import photos --angles-deg 10,55,100,145 --ignore-names --transfer gamma=2.2 --black 10 --white 250 --out stated",
        "import raw --kind division-of-focal-plane --out frame",
        "import colour --channel g --transfer srgb --out green",
        "import bracket --kind exposures --out exposures",
        "reconstruct hdr bracket --out hdr",
        "reconstruct polarization series --out maps",
        "reconstruct polarization green --out green-maps",
        "reconstruct polarization frame --out camera",
        "import raw --kind division-of-focal-plane --layout sony-colour --channel luminance --out coloured",
        "reconstruct polarization coloured --out colour-camera",
        "reconstruct polarization frame --out bilinear --demosaic bilinear",
        "reconstruct polarization frame --out edge-aware --demosaic edge-aware",
        "reconstruct polarization frame --out hues --palette hsv --no-scale-bar",
        "reconstruct polarization series --out gratings --model auto",
    ]),
    Case("hdr", {
        **{f"photos/{k}.png": i.lazy(i.bracket, exposure) for k, exposure in enumerate((2, 8, 32))},
        "photos/frames.json": i.exposures_json((0.01, 0.04, 0.16)),
    }, [
        "--json reconstruct hdr photos --out merged",
        "reconstruct hdr photos --out recovered --response recover",
        "--json reconstruct stack photos --out stacked",
        "reconstruct stack photos --out all --clip-sigma off",
        "reconstruct hdr photos --out again --response recovered/response.json --align off",
    ]),
    # Exposures from Exif tags: 1/100 s to 1/10 s.
    Case("camera", {
        f"{kind}/{k}.png": i.lazy(i.noisy, light // time, f"{kind} {k}", i.exif(1, time, 400))
        for kind, light in (("flats", 100_000), ("darks", 0)) for k, time in enumerate((100, 100, 20, 20, 10, 10))
    }, [
        "--json calibrate camera flats --darks darks --out camera",
    ]),
    Case("references", {
        **{f"{name}.toml": i.REFERENCE % (kind, turn, retardance) for name, kind, turn, retardance in (
            ("front", "polarizer", 20, 84), ("back", "polarizer", -20, 84), ("film", "mirror", 0, 84),
            ("bare", "mirror", 0, 0), ("paper", "paper", 0, 84), ("tile", "kinematic", 0, 84))},
    }, [
        *(f"sim render --bench {name}.toml --angles-deg {','.join(map(str, range(0, 360, 15)))} --out {name}"
          for name in ("front", "back", "film", "bare", "paper", "tile")),
        "--json calibrate analyser front --flipped back --axis-deg 20 --out analyser",
        "calibrate retarder film --bare bare --out retarder",
        "calibrate flat paper --out flat",
        "reconstruct polarization tile --model circle --out result",
        "calibrate orientation result --known-map tile/truth.exr --out orientation",
        "calibrate orientation result --known-deg 30 --center-px 3,4 --out no # code 2",
    ]),
    Case("lut", {"scene.toml": i.FLASH_SCENE, "near.toml": i.NEAR, "lamp.csv": i.LAMP, "scene-table.toml": i.TABLE_SCENE,
                 "colour.png": i.lazy(i.orders), "sky.hdr": i.lazy(i.environment)}, [
        "sim photograph flash --scene scene.toml --out photo",
        "reconstruct hdr photo --out hdr",
        "reconstruct lut hdr --wavelength 680 --scale 0.008 --size 64 --out table # code 1",
        "reconstruct lut hdr --wavelength 680 --geometry near.toml --size 64 --illuminant D65 --observer 1964 --method single --max-error 1 --out near",
        "reconstruct lut hdr --wavelength 680 --scale 0.008 --size 64 --illuminant lamp.csv --method fixed=20 --exponent 2 --warp 3 --max-error 1 --out fixed",
        "reconstruct lut hdr --wavelength 680 --scale 0.008 --size 64 --light hdr --light-scale 0.0005 --max-error 1 --out lit",
        "reconstruct lut colour.png --wavelength 610,540,460 --scale 0.01 --center 32,32 --size 64 --transfer linear --max-error 1 --out colour",
        "render scene-table.toml --samples 8 --out sheet.exr",
        "factor table/lut.exr --rank 2 --environment sky.hdr --out lit-factors",
        "factor table/lut.exr --max-error 0.1 --out factors",
        "factor table/lut.exr --rank 4 --kind nonnegative --directions-deg 0,90 --parts 2 --out nonnegative",
        "factor table/lut.exr --rank 1 --kind line --out line",
    ], within_rounding={
        "*/report.json": "error estimates are sums over threads (rayon's reduce, pattern/choose.rs and pattern/output.rs), "
                         "whose order depends on the threads' timing",
    }),
    Case("bokeh", {"scene.toml": i.BOKEH_SCENE}, [
        "sim photograph bokeh --scene scene.toml --out photo",
        "reconstruct bokeh photo/photograph.png --psf-sigma 2 --pixel-um 2.5 --out result",
        "reconstruct bokeh photo/photograph.png --psf-sigma 2 --lines-per-mm 25 --lens-focal-mm 250 --f-number 5.6 --distance-m 0.85 --known-shape sinusoid --known-depth-um 0.4 --iterations 8 --no-accelerate --out known",
        "reconstruct bokeh photo/photograph.png --psf-sigma 2 --pixel-um 2.5 --calibration known/calibration.json --crop 40,20,80,80 --rotate 90 --noise 20000,8 --out height",
    ]),
    Case("foil", {"scene.toml": i.FOIL_SCENE, "periods.csv": i.PERIODS, "maps.toml": i.MAPS_SCENE}, [
        "sim photograph foil --scene scene.toml --out photo",
        "reconstruct foil photo --geometry photo/geometry.json --depth-um 0.08 --period-um 0.75,1.75 --out found",
        "reconstruct foil photo --bins 24,16 --out coarse",
        "synthesize found --size 96,64 --pixel-um 25 --square-px 3 --out squares",
        "synthesize found/histogram.exr --size 96,64 --pixel-um 25 --disc-px 5 --seed 2 --out discs",
        "map edit squares --rotate 30 --tile 2,1 --layout mirror --scale 1.1 --out turned",
        "map edit squares --period quadratic=0.8,1.6 --resample 0.5 --orientation-offset 10 --out blend",
        "map edit squares --period periods.csv --size 50,40 --offset-um 0.02 --clamp 0.9,1.3 --out part",
        "map edit squares --size 48,32 --orientation-offset 2 --out corner",
        "map export turned --out pack",
        "map export blend --encoding linear --out linear",
        "map import pack --out back",
        "map import linear --out rounded",
        "map compare squares corner --out compared",
        "map compare squares discs --unaligned --out unaligned",
        "render maps.toml --samples 8 --out sheet.exr",
        "--json recommend squares --need orientation --out advice",
    ]),
    Case("flash", {"sheet.toml": i.TILES_SCENE}, [
        "sim photograph tiles --scene sheet.toml --out photos",
        "reconstruct flash photos --tiles 6x5 --size-mm 178.2x131.25 --out maps",
        "reconstruct flash photos --tiles 6x5 --size-mm 178.2x131.25 --orientation image --period pixel --unregistered --period-um 1.2:2.2 --out image",
        "recommend photos/room.png --out advice",
    ]),
    Case("spots", {"bench.toml": i.MOSAIC_BENCH, "plan.toml": i.SPOTS_PLAN}, [
        "plan check plan.toml --sim --bench bench.toml",
        "capture plan.toml --sim --bench bench.toml --out session",
        "check session",
        "reconstruct spots session --wavelength 561 --wavelength-sigma 1 --periods 1,3 --mirror 0.3 --out again",
    ]),
    Case("brdf", {"heights.txt": i.HEIGHTS, "section.csv": i.SECTION}, [
        "brdf surface blazed --period-um 2.5 --depth-um 0.3 --pixels 64 --out blazed.exr",
        "brdf surface sinusoid --period-um 2 --depth-um 0.1 --pixels 48 --pixel-um 0.1 --angle 20 --out sinusoid.exr",
        "brdf surface sinusoid --period-um 2 --depth-um 0.1 --pixels 48 --angle 90 --out whole.exr",
        "brdf surface rectangular --period-um 2 --depth-um 0.1 --duty 0.3 --pixels 48 --out rectangular.exr",
        "brdf surface cd --period-um 1.6 --depth-um 0.12 --pixels 64 --pixel-um 0.1 --out cd.exr",
        "brdf surface two-regions --period-um 1.6 --depth-um 0.12 --pixels 64 --pixel-um 0.1 --out two.exr",
        "brdf surface fingers --period-um 1.15 --depth-um 0.4 --pixels 64 --pixel-um 0.09 --angle 20 --out fingers.exr",
        "brdf map blazed.exr --size 48 --coherence-um 10 --out map.exr",
        "brdf map heights.txt --pixel-um 0.1 --range-um 0.2 --level --light 30,90 --size 32 --coherence-um 10 --illuminant D65 --material silicon --shadowing --normalisation relative --out text.exr",
        *[f"brdf map whole.exr --method {method} --size 16 --coherence-um 8 --max-error 0.5 --zoom 4 --center 0,0.2 --out {method}.exr{code}"
          for method, code in (("reference", ""), ("taylor", ""), ("chebyshev", ""), ("fft", ""), ("nmm", ""), ("pq", " # code 1"), ("pq-linear", " # code 1"))],
        "brdf slice blazed.exr --light 75,0 --wavelengths 450:650:50 --views=-90:90:5 --coherence-um 10 --out slice.csv",
        "brdf orders --period-um 2.5 --depth-um 0.3 --profile blazed --light 30 --wavelengths 450:650:50 --out orders.csv",
        "brdf orders --period-um 2.5 --profile section.csv --wavelengths 550 --out section-orders.csv",
        "brdf orders --period-um 1.66 --depth-um 0.2 --method taylor2 --wavelengths 550 --out taylor2.csv",
        "brdf check blazed.exr --light 75 --wavelengths 450:650:50 --coherence-um 10",
        "brdf check blazed.exr --light 60 --wavelengths 500,600 --coherence-um 10 --out peaks.csv",
        "brdf terms sinusoid.exr --coherence-um 8 --extent 0.5 --max-error 0.1 --out terms",
        "brdf terms sinusoid.exr --coherence-um 8 --method taylor --order 1 --extent 0.5 --max-error 0.5 --precision float --out first # code 1",
    ]),
    Case("render", {"scene.toml": i.RENDER_SCENE, "shapes.toml": i.SHAPES_SCENE, "quad.obj": i.QUAD, "heights.txt": i.HEIGHTS}, [
        "render scene.toml --samples 16 --check --out picture.exr",
        "render scene.toml --samples 8 --max-error 0.00001 --spectral 50 --out spectral.exr # code 1",
        "render scene.toml --samples 8 --wavelengths 5 --by-chance --keep state.exr --out kept.exr",
        "render scene.toml --samples 16 --wavelengths 5 --by-chance --keep state.exr --resume --out resumed.exr",
        "render scene.toml --samples 2 --frames 3 --turn light --out turning",
        "render shapes.toml --samples 8 --out shapes.exr",
    ]),
    Case("gallery", {}, ["render --gallery gallery --scenes tv-room,phone-room --samples 1"]),
    Case("calibrate", {
        **{f"boards/{k}.png": i.lazy(i.board, *pose) for k, pose in enumerate(i.BOARDS)},
        "lying.png": i.lazy(i.board, (0, 2), (3, 0, 440)),
        "highlight.png": i.lazy(i.highlight, 165, 125),
        "filter.csv": i.FILTER,
        "panel.toml": i.PAPER_BENCH,
    }, [
        "calibrate board --board 9x6 --panel-px 400,300 --square-px 36 --out board.png",
        "calibrate geometry boards --board 9x6 --square-mm 25 --wavelength 532,1 --check seen --out camera.json",
        "calibrate geometry camera.json --sample-photo lying.png --board 9x6 --square-mm 25 --out lying.json",
        "calibrate geometry camera.json --sample-corners 100,75,210,76,211,165,99,164 --sample-mm 110,90 --panel-px 1920,1080 --panel-pixel-mm 0.27 --panel-at 0,150,300 --panel-turn=-30,0,0 --highlight highlight.png --light-height-mm 300,5 --lamp A --filter filter.csv --out bench.json",
        "calibrate geometry highlight.png --relative --known-mm 150 --known-px 50,100,275,105 --camera-mm 500 --light-mm 200 --highlight 150,130 --out relative.json",
        "calibrate panel --sim --bench panel.toml --levels 6 --out panel.json",
    ]),
    Case("capture", {
        "bench.toml": i.BENCH, "disc.toml": i.DISC_BENCH, "polarization.toml": i.POLARIZATION_PLAN, "until.toml": i.UNTIL_PLAN,
        "bracket.toml": i.BRACKET_PLAN, "exposures.toml": i.EXPOSURES_PLAN, "free.toml": i.FREE_PLAN, "bokeh.toml": i.BOKEH_PLAN, "lut.toml": i.LUT_PLAN,
    }, [
        *[f"plan {verb} {plan}.toml --sim --bench bench.toml" for plan in ("polarization", "until", "exposures", "free")
          for verb in ("check", "estimate")],
        "capture polarization.toml --sim --bench bench.toml --out dry --dry-run",
        "capture polarization.toml --sim --bench bench.toml --out polarization",
        "capture until.toml --sim --bench bench.toml --out until",
        "capture bracket.toml --sim --bench disc.toml --out bracket",
        "capture exposures.toml --sim --bench bench.toml --out exposures",
        "capture free.toml --sim --bench bench.toml --out free",
        "--json capture lut.toml --sim --bench disc.toml --out lut",
        "capture bokeh.toml --sim --bench disc.toml --out bokeh",
        "capture --sim --resume polarization",
        "--json plan check until.toml --sim --bench bench.toml",
        "--json plan estimate until.toml --sim --bench bench.toml",
        "--json check free",
        *[f"check {session}" for session in ("polarization", "until", "bracket", "exposures", "free")],
        "reconstruct hdr exposures --out merged",
        "catalogue --catalogue catalogue.db rebuild .",
        "catalogue --catalogue catalogue.db list bracket --state finished",
        "catalogue --catalogue catalogue.db add free",
        "catalogue --catalogue catalogue.db list --kind free --json",
    ]),
    Case("bench", {"bench.toml": i.BENCH}, [
        "devices --sim --bench bench.toml",
        "--json devices --sim --bench bench.toml",
        "--json stage where --sim --bench bench.toml",
        "snap --sim --bench bench.toml --show disc:60@10,0 --exposure-ms 20 --analyser-deg 30 --out look.png",
        "snap --sim --bench bench.toml --show black --flash --out lit.png",
        "stage where --sim --bench bench.toml",
        "stage move 45 --sim --bench bench.toml",
        "stage home --sim --bench bench.toml",
        "flash test --sim --bench bench.toml",
        "show disc:30 --seconds 0.1 --sim --bench bench.toml",
        "init --sim --out nacre.toml",
        "token anna --role view",
    ]),
    Case("chart", {}, ["chart --list", "chart maps --quick --out charts"]),
]
