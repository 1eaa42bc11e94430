"""Makes the records of speed and those that are derived from runs of the command:

    python3 results/records.py [performance instructions peers scoring waits baselines scenarios ...] [--repeats 5] [--only TEXT] [--out results]

Without names: performance, instructions, peers, scoring and waits, 20 to 40 minutes of an otherwise idle machine. The command is $MICROSIG, or the
release build, which is built if necessary. Times are those of whole processes (`getrusage`): CPU time is user and system time of all threads.
`instructions --against results/performance/instructions/counts.csv` exits with code 1 if a count has grown by more than 2 %.
"""

import argparse
import csv
import json
import math
import os
import platform
import random
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HERE = ROOT / "results"
# Settings 1, 1a (with a cylindrical lens) and 2 of Rossi (2020), Table 1.
KEYS = (
    "magnification numerical_aperture focal_length ri_medium ri_lens pixel_size pixel_dim_x pixel_dim_y background_mean background_noise "
    "points_per_pixel n_rays gain cyl_focal_length"
).split()
SETTING_1 = dict(zip(KEYS, (10, 0.3, 350, 1, 1.5, 6.45, 752, 366, 350, 10, 18, 500, 3.2, 0)))
SETTING_1A = SETTING_1 | dict(cyl_focal_length=4000)
SETTING_2 = dict(zip(KEYS, (63, 0.75, 350, 1, 1.5, 6.45, 141, 141, 52, 5, 12, 250, 1.1, 0)))


# --- running programs ------------------------------------------------------------------------------------------------------------------


def measured(argv, **options):
    """Runs a program: (wall s, CPU s, peak MB), standard output, standard error."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        start = time.perf_counter()
        process = subprocess.Popen([str(a) for a in argv], stdin=subprocess.DEVNULL, stdout=out, stderr=err, **options)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - start
        out.seek(0), err.seek(0)
        out, err = out.read(), err.read()
    if process.returncode:
        raise RuntimeError(f"{' '.join(map(str, argv))}: exit code {process.returncode}\n{err}")
    return (wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1000), out, err


def built(package):
    """The release build of a package's program."""
    build = ["cargo", "build", "--release", "--quiet", "--package", package, "--message-format", "json"]
    lines = subprocess.run(build, cwd=ROOT, stdout=subprocess.PIPE, check=True, text=True).stdout.splitlines()
    return [m["executable"] for m in map(json.loads, lines) if m.get("executable")][-1]


def machine(program):
    """Version, processor, cores, system, compiler, load."""
    cpu = Path("/proc/cpuinfo").read_text()
    name = re.search(r"model name\s*: (.*)", cpu)[1] + (" with AVX-512" if "avx512f" in cpu else "")
    rustc = subprocess.run(["rustc", "--version"], capture_output=True, text=True).stdout.strip()
    version = subprocess.run([program, "--version"], capture_output=True, text=True).stdout.strip()
    build = "the build given by $MICROSIG" if "MICROSIG" in os.environ else "default release build"
    system = f"{platform.system().lower()} {platform.release().split('-')[0]}"
    return f"{version}, {name}, {os.cpu_count()} cores, {system}, {rustc}, {build}; load average {os.getloadavg()[0]:.2f} at the start"


def environment(requirements):
    """The interpreter of a virtual environment with the packages of a file, below target/python."""
    place = ROOT / "target/python" / requirements.parent.name
    done, wanted = place / "installed.txt", requirements.read_text()
    python = place / "bin/python"
    if not done.exists() or done.read_text() != wanted:
        venv.create(place, with_pip=True, clear=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", "-r", requirements], check=True)
        done.write_text(wanted)
    return python


ONE_THREAD = os.environ | dict.fromkeys(["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"], "1")


def table(head, rows):
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(map(str, row)) + " |\n" for row in lines) + "\n"


def save(out, text, rows=None, name="runs.csv"):
    """README.md, and a table of all numbers."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "README.md").write_text(text)
    if rows:
        with open(out / name, "w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)


def size_of(folder):
    return sum(f.stat().st_size for f in folder.rglob("*") if f.is_file())


# --- inputs ----------------------------------------------------------------------------------------------------------------------------


def settings_file(path, settings):
    path.write_text("".join(f"{key} = {value}\n" for key, value in settings.items()))
    return path


def rays(scratch, settings, images, particles, z=(-80, 40), d=(2, 2), mode=()):
    """Arguments that render data files with particles at random positions."""
    folder = Path(tempfile.mkdtemp(dir=scratch))
    draw = random.Random(1)
    (folder / "particles").mkdir()
    for image in range(images):
        rows = (
            f"{draw.uniform(0.5, settings['pixel_dim_x'] + 0.5):.3f} {draw.uniform(0.5, settings['pixel_dim_y'] + 0.5):.3f} "
            f"{draw.uniform(*z):.3f} {draw.uniform(*d):.4f}\n"
            for _ in range(particles)
        )
        (folder / f"particles/B{image:05}.txt").write_text("".join(rows))
    return ["render", settings_file(folder / "settings.txt", settings), folder / "particles", *mode]


def spots(scratch, side, ppp, timing):
    """Arguments that generate a dataset of Gaussian images."""
    file = Path(tempfile.mkdtemp(dir=scratch)) / "spots.ron"
    file.write_text(
        f'(name: "spots", seed: 1, optics: (gaussian: (diameter_px: 2.75), pixel_dim_x: {side}, pixel_dim_y: {side}),\n'
        f" motion: flow(field: uniform(velocity_um_s: (300, 100, 0))), particles: (number: ppp({ppp}), diameter_um: constant(1)),\n"
        f" boundaries: (z_um: (-5, 5), z: open), timing: {timing})\n"
    )
    return ["generate", file]


# --- performance: run time and memory of whole runs --------------------------------------------------------------------------------------

GROWTH = ["particles, rays", "particles, gaussian", "pixels, gaussian", "rays per point", "frames, gaussian"]
# CPU ms per particle of the original program as reported by its users, and the goal for the speedup.
ORIGINAL = {"setting 1, one size": (7.5, 8.5, 200), "setting 1, several sizes": (27, 29, 600), "setting 2": (170, 280, 800)}


def workloads(scratch):
    """(group, name, size, threads, arguments)"""
    one, two = SETTING_1, SETTING_2
    expected = ("--mode", "expected")
    yield "one thread", "setting 1, one size", 20, 1, rays(scratch, one, 20, 100)
    yield "one thread", "setting 1, several sizes", 20, 1, rays(scratch, one, 20, 100, d=(1.8, 2.2))
    yield "one thread", "setting 1a, one size", 20, 1, rays(scratch, SETTING_1A, 20, 100)
    yield "one thread", "setting 2", 40, 1, rays(scratch, two, 40, 10, (-40, 5), (1, 1))
    yield "one thread", "no particles", 100, 1, rays(scratch, one, 100, 0)
    yield "one thread", "setting 1, 500 particles, expected", 20, 1, rays(scratch, one, 20, 500, mode=expected)
    yield "one thread", "setting 1, 500 particles, expected, many images", 220, 1, rays(scratch, one, 220, 500, mode=expected)
    yield "one thread", "gaussian, 512 x 512, 0.03 ppp", 40, 1, spots(scratch, 512, 0.03, "pairs(count: 20)")
    yield "one thread", "quickstart.ron", 20, 1, ["generate", ROOT / "scenarios/quickstart.ron"]
    both = {"rays": rays(scratch, one, 20, 200), "gaussian": spots(scratch, 512, 0.03, "pairs(count: 20)")}
    for name, arguments in both.items():
        for threads in (1, 2):
            yield f"threads, {name}", f"{name}, {threads} threads", threads, threads, arguments
    for n in (50, 100, 200, 400):
        yield GROWTH[0], f"20 images of {n}", 20 * n, 1, rays(scratch, one, 20, n)
    for ppp in (0.02, 0.04, 0.08, 0.16):
        yield GROWTH[1], f"20 images, {ppp} ppp", round(ppp * 20 * 512**2), 1, spots(scratch, 512, ppp, "pairs(count: 10)")
    for side in (256, 512, 1024, 2048):
        yield GROWTH[2], f"8 images of {side} x {side} px", 8 * side**2, 1, spots(scratch, side, 0.03, "pairs(count: 4)")
    for n in (250, 500, 1000, 2000):
        yield GROWTH[3], f"{n} rays per point", n, 1, rays(scratch, one | dict(n_rays=n), 10, 100)
    for n in (250, 500, 1000, 2000):
        yield GROWTH[4], f"{n} frames of 128 x 128 px", n, 1, spots(scratch, 128, 0.02, f"sequence(frames: {n})")
    large = one | dict(pixel_dim_x=4096, pixel_dim_y=4096)
    yield "large", "rays, 100000 particles, 4096 x 4096 px", 1e5, 2, rays(scratch, large, 1, 100_000)
    yield "large", "gaussian, the same, 2 frames", 1e5, 1, spots(scratch, 4096, 1e5 / 4096**2, "sequence(frames: 2)")
    for n in (100, 10_000):
        yield "large", f"gaussian, {n} frames of 128 x 128 px", n, 1, spots(scratch, 128, 0.02, f"sequence(frames: {n})")


def yardstick(python, arguments, particles):
    """CPU ms per particle of the NumPy loop."""
    settings, data = arguments[1], arguments[2] / "few.dat"
    rows = (arguments[2] / "B00000.txt").read_text().splitlines()[:particles]
    data.write_text("\n".join(rows))
    said = measured([python, HERE / "performance/yardstick.py", settings, data], env=ONE_THREAD)[1]
    data.unlink()
    return json.loads(said.splitlines()[-1])["cpu_ms_per_particle"]


def performance(program, out, options):
    about = machine(program)
    runs, loops = {}, {}
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        all_ = [w for w in workloads(scratch) if options.only in w[0]]
        python = environment(HERE / "performance/requirements.txt") if options.only in "one thread" else None
        for repeat in range(options.repeats):
            for group, name, size, threads, arguments in all_:
                if group == "large" and repeat:
                    continue
                print(f"{repeat + 1}/{options.repeats}  {group}: {name}", flush=True)
                dataset = scratch / "out"
                target = [dataset] if arguments[0] == "render" else ["--out", dataset]
                usage, said, _ = measured([program, "--quiet", "--json", "--threads", threads, *arguments, *target])
                said = json.loads(said)
                row = dict(group=group, workload=name, size=size, threads=threads, images=said["images"], particles=said.get("particles", 0))
                runs.setdefault((group, name), []).append((row | dict(output_mb=size_of(dataset) / 1e6), usage))
                shutil.rmtree(dataset)
                if python and name in ORIGINAL:
                    loops.setdefault(name, []).append(yardstick(python, arguments, 3 if name == "setting 2" else 20))
        starts = [measured([program, "--version"])[0] for _ in range(25)]
    rows = []
    for several in runs.values():
        wall, cpu, peak = (statistics.median(usage[i] for _, usage in several) for i in range(3))
        row = several[0][0] | dict(repeats=len(several), wall_s=round(wall, 4), cpu_s=round(cpu, 4), peak_mb=round(peak, 1))
        rows.append(row | dict(output_mb=round(row["output_mb"], 3)))
    by_name, groups = {r["workload"]: r for r in rows}, {}
    for r in rows:
        groups.setdefault(r["group"], []).append(r)

    text = (
        f"# Speed and memory\n\nMade by `python3 results/records.py performance`: {about}.\n\nWhole runs of the command, including noise and "
        f"files. Medians of {options.repeats} interleaved runs; CPU time is user and system time of all threads. `runs.csv` has every figure.\n\n"
        "## Requirements and goals\n\n"
    )
    bars = [("starting and exiting the program", 1e3 * statistics.median(max(u[:2]) for u in starts), " ms", 10, "below")]
    if "quickstart.ron" in by_name:
        bars.append(("quickstart, CPU time", by_name["quickstart.ron"]["cpu_s"], " s", 1, "below"))
    growths = {}
    for group in GROWTH:
        pairs = zip(groups.get(group, []), groups.get(group, [])[1:])
        growths[group] = [(b["cpu_s"] / a["cpu_s"]) ** (1 / math.log2(b["size"] / a["size"])) for a, b in pairs]
    if steps := sum(growths.values(), []):
        bars.append(("largest growth of CPU time when the size doubles", max(steps), "", 2.2, "below"))
    few, many = (by_name.get(f"gaussian, {n} frames of 128 x 128 px") for n in (100, 10_000))
    if few and many:
        bars.append(("memory for 10,000 frames relative to 100 frames", many["peak_mb"] / few["peak_mb"], "", 1.2, "below"))
    few, many = (by_name.get("setting 1, 500 particles, expected" + more) for more in ("", ", many images"))
    if few and many:
        rate = (many["images"] - few["images"]) / (many["cpu_s"] - few["cpu_s"])
        bars.append(("images of 500 particles per CPU s, expected, excluding tables", rate, "", 1000, "above"))
    for name in ("rays", "gaussian"):
        if pair := groups.get(f"threads, {name}"):
            bars.append((f"speedup by a second core: {name}", pair[0]["wall_s"] / pair[1]["wall_s"], "", 1.95, "above"))
    met = lambda found, bar, side: "yes" if (found < bar) == (side == "below") else "**no**"
    text += table(
        ["", "measured", "limit", "met"],
        [[what, f"{found:.3f}{unit}", f"{bar}{unit}", met(found, bar, side)] for what, found, unit, bar, side in bars],
    )
    if loops:
        text += (
            "## Comparison with a NumPy loop and the original\n\n`yardstick.py` is a NumPy loop that traces every ray of every particle and "
            "reproduces the counts of the original exactly (`yardstick.py --check tests/data/exact`); its runs were interleaved with those of "
            "microsig. The times of the original were reported by its users on other machines, so ratios to them are orders of magnitude. For "
            "particles of one size, the original uses one light field for all particles, which neither microsig nor the NumPy loop does.\n\n"
        )
        lines = []
        for name, (low, high, goal) in ORIGINAL.items():
            ms, loop = 1e3 * by_name[name]["cpu_s"] / by_name[name]["particles"], statistics.median(loops[name])
            lines.append([name, f"{ms:.3f}", f"{loop:.1f}", f"{loop / ms:.0f}", f"{low} to {high}", f"{low / ms:.0f} to {high / ms:.0f}", goal])
        head = ["CPU ms per particle", "microsig, everything included", "NumPy loop", "speedup", "original, reported"]
        text += table([*head, "speedup over the original", "goal"], lines)
    for group, title in (("one thread", "One thread"), ("large", "Large runs (one run each)")):
        if group in groups:
            lines = [
                [r["workload"], r["threads"], r["images"], r["particles"], f"{r['cpu_s']:.3f}", f"{r['wall_s']:.3f}"]
                + [f"{r['images'] / r['cpu_s']:.0f}", f"{r['particles'] / r['cpu_s']:.0f}", f"{r['peak_mb']:.0f}", f"{r['output_mb']:.0f}"]
                for r in groups[group]
            ]
            head = ["", "threads", "images", "particles in all", "CPU s", "wall s", "images per CPU s", "particles per CPU s", "peak MB"]
            text += f"## {title}\n\n" + table([*head, "written MB"], lines)
    text += 'For `generate`, "particles" are those in view; it also writes truth, checksums and data files.\n\n'
    if any(growths.values()):
        lines = [
            [f"{g}: " + ", ".join(str(r["size"]) for r in groups[g]), *(", ".join(f"{r[k]}" for r in groups[g]) for k in ("cpu_s", "peak_mb"))]
            + [", ".join(f"{s:.2f}" for s in growths[g])]
            for g in GROWTH
            if g in groups
        ]
        text += "## Growth\n\n" + table(["", "CPU s", "peak MB", "CPU time per doubling"], lines)
    save(out, text, rows)


# --- instructions: counts that do not depend on the load of the machine ------------------------------------------------------------------


def instructions(program, out, options):
    if not shutil.which("valgrind"):
        return print("skipped: valgrind is not installed")
    before = {}
    if options.against:
        before = {row["run"]: int(row["instructions"]) for row in csv.DictReader(open(options.against))}
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        small = SETTING_1 | dict(pixel_dim_x=256, pixel_dim_y=256)
        spot = ["generate", scratch / "spots.ron"]
        spot[1].write_text(
            '(name: "spots", optics: (gaussian: (diameter_px: 2.75), pixel_dim_x: 256, pixel_dim_y: 256), motion: flow(field: lamb_oseen()), '
            "particles: (number: ppp(0.03)), boundaries: (z_um: (-5, 5)), timing: pairs(count: 4))"
        )
        dataset, result = scratch / "dataset", scratch / "result.csv"
        measured([program, *spot, "--out", dataset, "--quiet"])
        track = ["track", "--method", "spots", dataset]
        measured([program, *track, "--out", result, "--quiet"])
        runs = {
            "start": ["--version"],
            "8 images of noise": rays(scratch, small, 8, 0),
            "rays of 20 particles": rays(scratch, small, 1, 20, (-60, 20)),
            "4 pairs of spots": spot,
            "spots tracked": track,
            "spots evaluated": ["evaluate", "--json", dataset, result],
        }
        rows, lines, grown = [], [], False
        for name, arguments in runs.items():
            new = scratch / "new"
            more = {"render": [new], "generate": ["--out", new], "track": ["--out", new]}.get(arguments[0], [])
            if arguments[0] != "--version":
                more += ["--quiet", "--threads", 1]
            callgrind = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
            count = int(re.search(r"Collected : (\d+)", measured([*callgrind, program, *arguments, *more])[2])[1])
            shutil.rmtree(new) if new.is_dir() else new.unlink(missing_ok=True)
            change = count / before[name] - 1 if name in before else 0
            grown |= change > 0.02
            rows.append(dict(run=name, instructions=count))
            lines.append([name, f"{count / 1e6:.1f}", *([f"{before[name] / 1e6:.1f}", f"{100 * change:+.1f} %"] if name in before else ["", ""])])
            print(*lines[-1], flush=True)
    text = (
        f"# Instructions of small runs\n\nMade by `python3 results/records.py instructions`: {machine(program)}.\n\nCounted by callgrind on one "
        "thread. The processor emulated by valgrind has AVX2 but not AVX-512. `--against counts.csv` compares with earlier counts.\n\n"
    )
    save(out, text + table(["", "million instructions", "before", "change"], lines), rows, "counts.csv")
    if grown:
        sys.exit("a count has grown by more than 2 %")


# --- peers: in-focus image pairs in memory -----------------------------------------------------------------------------------------------


def peers(program, out, options):
    about, xtask, python = machine(program), built("xtask"), environment(HERE / "peers/requirements.txt")
    rows = []
    for repeat in range(options.repeats):
        for ppp, diameter in ((0.03, 2.75), (0.05, 4.2)):
            print(f"{repeat + 1}/{options.repeats}  {ppp} ppp, {diameter} px", flush=True)
            row = dict(ppp=ppp, diameter_px=diameter, run=repeat + 1)
            cpu = measured([xtask, "pairs", 400, ppp, diameter])[0][1]
            rows.append(row | dict(program="microsig", cpu_ms_per_pair=1e3 * cpu / 400))
            for name, script, pairs in (("SynthPix", "synthpix_pairs.py", 50), ("synpivimage", "synpivimage_pairs.py", 2)):
                said = measured([python, HERE / "peers" / script, pairs, ppp, diameter], env=ONE_THREAD)[1]
                said = json.loads(said.splitlines()[-1])
                rows.append(row | dict(program=name, cpu_ms_per_pair=1e3 * said["cpu_s"] / said["pairs"]))
    ms = {}
    for r in rows:
        ms.setdefault((r["ppp"], r["diameter_px"], r["program"]), []).append(r["cpu_ms_per_pair"])
    ms = {key: statistics.median(values) for key, values in ms.items()}
    lines = [[*key, f"{v:.3f}", f"{1e3 / v:.1f}", f"{v / ms[*key[:2], 'microsig']:.1f}"] for key, v in sorted(ms.items())]
    head = ["particles per pixel", "e^-2 diameter, px", "program", "CPU ms per pair", "pairs per CPU s", "time relative to microsig"]
    text = (HERE / "peers/README.md").read_text().split("| particles per pixel")[0]
    text = re.sub(r"Made by .*?\n\n", lambda _: f"Made by `python3 results/records.py peers`: {about}.\n\n", text, count=1, flags=re.S)
    save(out, text + table(head, lines) + "The goal is 10 times SynthPix.\n", rows)


# --- waits: places where a user waits, before and after ----------------------------------------------------------------------------------


def waits(program, out, options):
    if not options.before:
        return print("skipped: needs --before PROGRAM of an earlier version")
    quick, number = ROOT / "scenarios/quickstart.ron", lambda n: f"--set=particles.number=count({n})"
    infocus = [ROOT / "scenarios/piv_gaussian.ron", "--set=particles.number=ppp(0.005)"]
    rods = [ROOT / "scenarios/spheroids_in_shear.ron", "--set=timing=sequence(frames: 2, dt_s: 0.005)"]
    large = ["--set=optics.pixel_dim_x=8192", "--set=optics.pixel_dim_y=8192", "--set=timing=pairs(count: 1)", number(10_000)]
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        sizes = rays(scratch, SETTING_1, 20, 500, d=(1.5, 2.5), mode=("--mode", "waves", "--wavelength", "0.52"))
        # work, repeats, dataset to track or None, arguments
        works = [
            ("`track --method ncc`, quickstart", 3, [quick], ["track", "--method", "ncc"]),
            ("`track --method mle`, quickstart", 3, [quick], ["track", "--method", "mle"]),
            ("`track --method spots`, 20 images of 512 x 512 px", 3, infocus, ["track", "--method", "spots"]),
            ("`track --method mle --shape spheroid --aspect-ratio 3`, 2 images of spheroids_in_shear", 1, rods,
             ["track", "--method", "mle", "--shape", "spheroid", "--aspect-ratio", "3"]),
            ("the same without `--aspect-ratio`", 1, rods, ["track", "--method", "mle", "--shape", "spheroid"]),
            ("`track --method aptv`, quickstart_astigmatic", 3, [ROOT / "scenarios/quickstart_astigmatic.ron"], ["track", "--method", "aptv"]),
            ("`track --method piv`, 10 pairs", 3, [ROOT / "scenarios/piv_gaussian.ron"], ["track", "--method", "piv"]),
            ("`generate`, walls of a channel, 2 images of 128 x 128 px", 3, None)
            + ([*spots(scratch, 128, 0.03, "pairs(count: 1)"), "--set=motion=flow(field: poiseuille(max_speed_um_s: 1000))", "--set=boundaries.z=wall"],),
            ("`generate`, `expected`, 100 images of 500 particles", 3, None)
            + (["generate", quick, "--set=render.mode=expected", number(500), "--set=timing=pairs(count: 50)"],),
            ("`render --mode waves`, 20 images of 500 particles of 1.5 to 2.5 um", 3, None, sizes),
            ("`generate objective_20x_cylinder` (waves)", 1, None, ["generate", ROOT / "scenarios/objective_20x_cylinder.ron"]),
            ("`generate`, a pair of 8192 x 8192 px, 10,000 particles", 1, None, ["generate", quick, *large]),
        ]
        lines, rows = [], []
        for name, repeats, dataset, arguments in works:
            if options.only not in name:
                continue
            usage = {"before": [], "now": []}
            for _ in range(repeats):
                for which, binary in (("before", options.before), ("now", program)):
                    # Each version makes its own dataset, and its tables anew in an empty cache.
                    env = dict(os.environ, XDG_CACHE_HOME=tempfile.mkdtemp(dir=scratch))
                    data, made = scratch / which, scratch / "made"
                    if dataset and not data.exists():
                        measured([binary, "--quiet", "generate", *dataset, "--out", data], env=env)
                    target = [made] if arguments[0] == "render" else ["--out", made]
                    usage[which].append(measured([binary, "--quiet", *arguments, *[data] * bool(dataset), *target], env=env)[0])
                    shutil.rmtree(made) if made.is_dir() else made.unlink()
            for which in usage:
                shutil.rmtree(scratch / which, ignore_errors=True)
            cpu, peak = ({which: statistics.median(u[k] for u in several) for which, several in usage.items()} for k in (1, 2))
            rows.append(dict(work=name, **{f"{k}_cpu_s": round(v, 3) for k, v in cpu.items()}, **{f"{k}_mb": round(v) for k, v in peak.items()}))
            lines.append([name, f"{cpu['before']:.3g}", f"{cpu['now']:.3g}", f"{cpu['before'] / cpu['now']:.2g}", *(f"{v:.0f}" for v in peak.values())])
            print(*lines[-1], sep=" | ", flush=True)
    before = measured([options.before, "--version"])[1].strip()
    text = (
        f"# Where users wait, before and now\n\nMade by `python3 results/records.py waits --before PROGRAM` with {before} as PROGRAM and "
        f"{machine(program)}.\n\nWhole runs with an empty cache of tables and all threads, interleaved; medians of up to 3. CPU time is user "
        "and system time of all threads.\n\n"
    )
    save(out, text + table(["work", "before, CPU s", "now, CPU s", "before / now", "before, peak MB", "now, peak MB"], lines), rows)


# --- scoring: a million points, and frames with many neighbors within the gate ----------------------------------------------------------


def scoring(program, out, options):
    # name, frames, particles, side px, depth, exchanged after frames, ghosts per miss, gate px, CPU s and MB allowed
    cases = [
        ("a million points in 3-D", 1000, 1000, 1000, True, 0, 0.8, 2, (10, 1000)),
        ("a million points in 3-D, a gate with 6 neighbors", 1000, 1000, 300, True, 0, 0.8, 20, None),
        ("one frame, a gate with 4 neighbors", 1, 50_000, 1000, False, 0, 0.8, 5, (5, 1000)),
        ("one frame, a gate with 16 neighbors", 1, 50_000, 1000, False, 0, 0.8, 10, (5, 1000)),
        ("one frame, a gate with 63 neighbors", 1, 50_000, 1000, False, 0, 0.8, 20, None),
        ("the same with 16, as many found as true particles", 1, 50_000, 1000, False, 0, 1.0, 10, None),
        ("a gate with 56 neighbors, wrong identities", 20, 4000, 300, False, 5, 0.8, 20, None),
    ]
    about, lines, over = machine(program), [], False
    with tempfile.TemporaryDirectory() as scratch:
        truth, result = Path(scratch, "truth.csv"), Path(scratch, "result.csv")
        for name, frames, particles, side, depth, exchanged, ghosts, gate, bar in cases:
            draw, size = random.Random(1), (side, side, 80) if depth else (side, side)
            places = [[s * draw.random() for s in size] for _ in range(particles)]
            numbers, tracks = list(range(particles)), particles
            with open(truth, "w") as true, open(result, "w") as found:
                for file in (true, found):
                    file.write("frame,track,x_px,y_px" + (",z_um\n" if depth else "\n"))
                put = lambda file, track, at: file.write(f"{frame},{track}," + ",".join(f"{v:.3f}" for v in at) + "\n")
                for frame in range(frames):
                    if exchanged and frame and frame % exchanged == 0:
                        numbers = numbers[17:] + numbers[:17]
                    for track, (x, *rest) in enumerate(places):
                        at = [x + 0.5 * frame, *rest]
                        put(true, track, at)
                        if draw.random() < 0.1:
                            if draw.random() < ghosts:
                                put(found, "", [s * draw.random() for s in size])
                            continue
                        if draw.random() < 0.05:
                            numbers[track], tracks = tracks, tracks + 1
                        put(found, numbers[track], [v + draw.uniform(-1, 1) for v in at])
            evaluate = ["evaluate", truth, result, "--threads", 1, "--json", "--quiet", "--gate-xy", gate]
            evaluate += ["--gate", "ellipsoid", "--depth", 0, 80] if depth else ["--gate", "radial"]
            (_, cpu, peak), said, _ = measured([program, *evaluate])
            score = json.loads(said)
            over |= bool(bar) and (cpu > bar[0] or peak > bar[1])
            scores = [(score[k] or {}).get(v) for k, v in (("detection", "f1"), ("links", "f1"), ("hota", "hota"), ("identity", "idf1"))]
            scores = ["–" if s is None else f"{s:.4f}" for s in scores]
            lines.append([name, frames, particles, gate, f"{cpu:.2f}", f"{peak:.0f}", f"{bar[0]} s, {bar[1]} MB" if bar else "–", *scores])
            print(*lines[-1], sep=" | ", flush=True)
    text = (
        f"# Run time and memory of scoring\n\nMade by `python3 results/records.py scoring`: {about}.\n\n"
        "In the results a tenth of the particles is missing, there are 0.8 ghosts per missing particle, errors are up to 1 px and 1 um, and "
        "tracks break in one of 20 frames. Each case is one run of `microsig evaluate --threads 1`: reading, matching at all gates, "
        "detection, links, ISBI (twice in 3-D), HOTA, CLEAR, identity, GDPT, LPT, curves and all intervals. CPU time is user and system time. "
        "HOTA considers four times as many neighbors as the gate admits (eight times in 3-D).\n\n"
    )
    save(out, text + table(["case", "frames", "particles", "gate, px", "CPU, s", "peak, MB", "bar", "F1", "link F1", "HOTA", "IDF1"], lines))
    if over:
        sys.exit("a limit is exceeded")


# --- baselines: scores over density and noise --------------------------------------------------------------------------------------------


def value(tree, path):
    for key in path.split("."):
        tree = (tree or {}).get(key)
    return tree


POINTS = {
    "precision": "detection.precision", "recall": "detection.recall", "x, px": "detection.rmse_x_px", "y, px": "detection.rmse_y_px",
    "z, um": "detection.rmse_z_um", "link F1": "links.f1",
}  # fmt: skip
VECTORS = {
    "AEE, px": "field.aee_px", "u, px": "field.u_inliers.rms_px", "v, px": "field.v_inliers.rms_px", "outliers": "field.outlier_fraction",
    "valid": "field.valid_vector_probability",
}  # fmt: skip


def baselines(program, out, options):
    about, rows = machine(program), []
    number = lambda text: {"particles.number": text}
    five = {"timing": "pairs(count: 5, dt_s: 0.005)"}
    cases = []
    for group, scenario, methods in (
        ("Defocused, spherical lens", "quickstart", ["ncc", "mle"]),
        ("Astigmatic", "quickstart_astigmatic", ["ncc", "mle", "aptv"]),
    ):
        for noise in (10, 50):
            cases += [(group, scenario, noise, n, number(f"count({n})") | five, methods) for n in (12, 46, 150)]
    for noise in (10, 50):
        cases += [("In focus", "piv_gaussian", noise, ppp, number(f"ppp({ppp})"), ["spots"]) for ppp in (0.001, 0.003, 0.01, 0.03)]
        cases += [("Fields", "piv_gaussian", noise, ppp, number(f"ppp({ppp})"), ["piv", "static"]) for ppp in (0.01, 0.03, 0.1)]
    cases.append(("Anchors", "quickstart", 10, 46, {}, ["truth-noise", "offset", "empty"]))
    with tempfile.TemporaryDirectory() as scratch:
        dataset, result, scores = (Path(scratch, name) for name in ("dataset", "result.csv", "scores"))
        for group, scenario, noise, particles, changes, methods in cases:
            if options.only not in group:
                continue
            sets = [f"--set={key}={v}" for key, v in ({"optics.background_noise": noise} | changes).items()]
            measured([program, "generate", scenario, "--out", dataset, "--force", "--quiet", *sets])
            manifest = json.loads((dataset / "datapackage.json").read_text())["microsig"]
            for method in methods:
                track = [program, "track", dataset, "--method", method, "--force", "--json", "--out", result]
                (_, cpu, _), said, _ = measured(track)
                measured([program, "evaluate", dataset, result, "--force", "--quiet", "--out", scores])
                score = json.loads((scores / "score.json").read_text())
                row = dict(group=group, tracker=method, noise=noise, particles=particles, n_s=find(manifest, "n_s"))
                row["cpu_s_per_frame"] = round(cpu / json.loads(said)["frames"], 3)
                rows.append(row | {path: value(score, path) for path in (POINTS | VECTORS).values()})
                print(*list(rows[-1].values())[:10], flush=True)
    text = (
        f"# Scores of the baseline trackers\n\nMade by `python3 results/records.py baselines`: {about}. All numbers are in `runs.csv`; seeds are "
        "those of the scenarios.\n\nEach dataset is a scenario of `scenarios/` with a different noise level or number of particles. `noise` is the "
        "standard deviation of the background in counts, `N_S` the source density (total area of the particle images divided by the area of the "
        "image). Scores are those of `microsig evaluate` with its default gates, 2 px and h/10. Recall and errors must be considered together, "
        "because a point outside the gate counts as a miss and a ghost. Errors are RMS errors about zero; those of vectors include valid vectors "
        "with an error below 1 px. CPU time is that of `microsig track`, including reading and linking. `static` is a field of zeros; the anchors "
        "are made from the ground truth: with noise of 0.1 px and 1 um, shifted by one pixel, empty.\n\n"
    )
    for group in dict.fromkeys(r["group"] for r in rows):
        columns = VECTORS if group == "Fields" else POINTS
        show = lambda v: "–" if v is None else f"{v:.3f}"
        lines = [
            [r["tracker"], r["noise"], r["particles"], show(r["n_s"]), *(show(r[path]) for path in columns.values()), r["cpu_s_per_frame"]]
            for r in rows
            if r["group"] == group
        ]
        text += f"## {group}\n\n" + table(["tracker", "noise", "particles", "N_S", *columns, "CPU, s/frame"], lines)
    save(out, text, rows)


def find(tree, key):
    """The first value with this key, or its median."""
    if isinstance(tree, dict) and key in tree:
        return tree[key]["median"] if isinstance(tree[key], dict) else tree[key]
    for branch in tree.values() if isinstance(tree, dict) else tree if isinstance(tree, list) else ():
        if (found := find(branch, key)) is not None:
            return found


# --- scenarios: every shipped file at full size, twice ----------------------------------------------------------------------------------


def scenarios(program, out, options):
    about, rows, failures = machine(program), [], []
    for file in sorted((ROOT / "scenarios").glob("*.ron")):
        if options.only not in file.stem:
            continue
        with tempfile.TemporaryDirectory() as scratch:
            made, is_sweep = Path(scratch, "out"), "axes:" in file.read_text()
            try:
                generate = measured([program, "--quiet", "sweep" if is_sweep else "generate", file, "--out", made])[0]
                datasets = [made / row["path"] for row in csv.DictReader(open(made / "cases.csv"))] if is_sweep else [made]
                verify = [measured([program, "--quiet", "verify", "--regenerate", dataset])[0] for dataset in datasets]
            except RuntimeError as error:
                failures.append(f"{file.name}: {error}")
                continue
            images = sum(len(list((dataset / "images").iterdir())) for dataset in datasets)
            row = dict(scenario=file.stem, datasets=len(datasets), images=images, bytes=size_of(made))
            row |= dict(generate_cpu_s=round(generate[1], 2), verify_cpu_s=round(sum(v[1] for v in verify), 2))
            rows.append(row)
            print(*row.values(), flush=True)
    text = (
        f"# Cost of the shipped scenarios\n\nMade by `python3 results/records.py scenarios`: {about}.\n\nEvery file of `scenarios/` is generated "
        "at full size and checked with `microsig verify --regenerate`, which generates the dataset again and compares all bytes (for a sweep: "
        f"all cases). CPU times are those of all threads.\n\n{len(rows)} of {len(rows) + len(failures)} files pass.\n\n"
    )
    lines = [
        [f"[`{r['scenario']}`](../../scenarios/{r['scenario']}.ron)", r["datasets"], r["images"], f"{r['bytes'] / 1e6:.1f}"]
        + [r["generate_cpu_s"], r["verify_cpu_s"]]
        for r in rows
    ]
    text += table(["scenario", "datasets", "images", "size, MB", "generate, CPU s", "verify, CPU s"], lines)
    save(out, text + "".join(f"Failed: {failure}\n\n" for failure in failures), rows, "scenarios.csv")
    if failures:
        sys.exit("\n".join(failures))


RECORDS = {
    "performance": performance,
    "instructions": instructions,
    "peers": peers,
    "scoring": scoring,
    "waits": waits,
    "baselines": baselines,
    "scenarios": scenarios,
}
PLACES = {"instructions": "performance/instructions", "waits": "performance/waits"}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("records", nargs="*", choices=[[], *RECORDS], help="default: those of speed")
    parser.add_argument("--repeats", type=int, default=5, help="number of runs of each workload")
    parser.add_argument("--only", default="", help="only groups whose name contains this text")
    parser.add_argument("--against", type=Path, help="counts.csv of an earlier version to compare instructions with")
    parser.add_argument("--before", type=Path, help="program of an earlier version to compare waits with")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the records")
    options = parser.parse_args()
    program = os.environ.get("MICROSIG") or built("microsig")
    for name in options.records or list(RECORDS)[:5]:
        RECORDS[name](program, options.out / PLACES.get(name, name), options)
