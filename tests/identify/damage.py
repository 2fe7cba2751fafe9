"""Damaged logs of every kind through the command line: what a file may hold without harm to who reads it.

`python tests/identify/damage.py --cases 560 --seed 7` prints a line for each fault and the counts; exit
status 1: there is a fault. Each case is a process of its own, of bounded memory and time.
"""

from __future__ import annotations

import argparse
import gzip
import io
import os
import resource
import signal
import struct
import sys
import traceback
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

ROWS = 601
MEMORY_MOST = 3 << 29  # B beyond what the process has at its start: 1 GiB of numbers, and what reads them
TIME_MOST = 30  # s of the processor
WAIT_MOST = 600  # s, if it only waits
TOO_SHORT = "no log turns at a steady speed for a revolution; record one that does\n"
DRIVE = """
[motor]
pole_pairs = 4
R_s = "1 ohm"
L_d = "1 mH"
L_q = "1 mH"
K_t = "0.3 N*m/A"
[drive]
rates = { current_loop = "10 kHz", speed_loop = "1 kHz" }
current_loop = { bandwidth = "500 Hz", current_limit = "10 A" }
inverter = { bus_voltage = "48 V" }
"""
ID = '[columns]\nt = "time"\ntheta = "angle"\nomega = "speed"\n' + DRIVE


def columns() -> dict[str, np.ndarray]:
    """Two turns and a half, with a ripple of order 8."""
    time = np.arange(ROWS) / 200
    angle = 2 * np.pi * time * 0.8
    angle += 2e-3 * np.sin(8 * angle)
    return {"time": time, "angle": angle, "speed": np.gradient(angle, time)}


def csv_text() -> bytes:
    rows = zip(*columns().values(), strict=True)
    lines = (",".join(f"{value:.9g}" for value in row) for row in rows)
    return "\n".join([",".join(columns()), *lines, ""]).encode()


def npz(packed: bool) -> bytes:
    file = io.BytesIO()
    (np.savez_compressed if packed else np.savez)(file, **columns())
    return file.getvalue()


def mat(without: str = "", **form: object) -> bytes:
    from scipy.io import savemat

    file = io.BytesIO()
    savemat(file, {name: values for name, values in columns().items() if name != without}, **form)
    return file.getvalue()


def trace(path: Path, **form: object) -> bytes:
    import netCDF4

    with netCDF4.Dataset(path, "w") as file:
        group = file.createGroup("steady").createGroup("pi")
        group.createDimension("time", ROWS)
        for name, values in columns().items():
            group.createVariable(name, "f8", ("time",), **form)[:] = values
    return path.read_bytes()


def parquet(**form: object) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = io.BytesIO()
    pq.write_table(pa.table(columns()), file, **form)
    return file.getvalue()


def mdf(path: Path, compression: int) -> bytes:
    import asammdf

    with asammdf.MDF() as file:
        time, *others = columns().items()
        file.append([asammdf.Signal(values, time[1], name=name) for name, values in others])
        file.save(path, overwrite=True, compression=compression)
    return path.read_bytes()


def sound_files(folder: Path) -> dict[str, list[bytes]]:
    """Undamaged files by the ending of their names."""
    by_kind = {
        ".csv": [csv_text()],
        ".csv.gz": [gzip.compress(csv_text(), mtime=0)],
        ".npz": [npz(False), npz(True)],
        ".mat": [mat(), mat(do_compression=True), mat(format="4")],
        ".nc": [trace(folder / "a.nc"), trace(folder / "b.nc", zlib=True, shuffle=True)],
    }
    by_kind[".mat"].append(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + bytes(384) + by_kind[".nc"][0])
    with suppress(ImportError):
        by_kind[".parquet"] = [parquet(), parquet(compression="zstd", use_dictionary=False)]
    with suppress(ImportError):
        by_kind[".mf4"] = [mdf(folder / "a.mf4", 0), mdf(folder / "b.mf4", 2)]
    return by_kind


def cut(content: bytes, chance: np.random.Generator) -> bytes:
    return content[: chance.integers(len(content))]


def flipped(content: bytes, chance: np.random.Generator) -> bytes:
    """A few bits flip anywhere, more often in the first or the last thousand bytes, where headers are."""
    array = np.frombuffer(content, np.uint8).copy()
    place = chance.choice(["anywhere", "first", "last"])
    span = len(array) if place == "anywhere" else min(1024, len(array))
    places = chance.integers(span, size=chance.integers(1, 9))
    np.bitwise_xor.at(array, -1 - places if place == "last" else places, 1 << chance.integers(8, size=1)[0])
    return array.tobytes()


def blanked(content: bytes, chance: np.random.Generator) -> bytes:
    """A block of the file becomes one value, as on a disk that failed."""
    first, size = chance.integers(len(content)), chance.integers(1, 4096)
    block = content[first : first + size]
    return content[:first] + bytes([chance.choice([0, 0, 255])]) * len(block) + content[first + size :]


def oversized(content: bytes, chance: np.random.Generator) -> bytes:
    """One number of rows or of bytes, somewhere in the file, becomes an absurd one."""
    sizes = [ROWS, 8 * ROWS, 8 * ROWS + 128, 24 * ROWS, len(content)]
    spots = []
    for form in ("<Q", "<I"):
        for size in sizes:
            needle, start = struct.pack(form, size), 0
            while (start := content.find(needle, start)) >= 0:
                spots.append((start, form))
                start += 1
    absurd = {"<Q": [1 << 40, 1 << 62, (1 << 64) - 1], "<I": [1 << 28, (1 << 31) - 1, (1 << 32) - 1]}
    if not spots:
        spots, absurd = [(int(chance.integers(len(content))), "<I")], {"<I": [0x7FFFFFFF, 0xFFFFFFFF]}
    start, form = spots[chance.integers(len(spots))]
    value = struct.pack(form, absurd[form][chance.integers(len(absurd[form]))])
    return content[:start] + value + content[start + len(value) :]


DAMAGES: dict[str, Callable[[bytes, np.random.Generator], bytes]] = {
    "cut": cut,
    "flipped": flipped,
    "blanked": blanked,
    "oversized": oversized,
}


def npy_header(shape: tuple[int, ...]) -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return file.getvalue()


def claims_npz(shape: tuple[int, ...]) -> bytes:
    """An archive whose headers claim these shapes; its sizes are true."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name in columns():
            archive.writestr(f"{name}.npy", npy_header(shape) + bytes(80))
    return file.getvalue()


def bomb_npz(rows: int) -> bytes:
    """Sound columns, and one of that many zeros."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, values in columns().items():
            of_zeros = name == "speed"
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                member.write(npy_header((rows if of_zeros else ROWS,)))
                member.write(b"" if of_zeros else values.tobytes())
                for _ in range(rows >> 17 if of_zeros else 0):
                    member.write(bytes(1 << 20))
    return file.getvalue()


def bomb(first: bytes, block: bytes, blocks: int, wbits: int) -> bytes:
    """Deflated bytes that unpack to the first and so many blocks; the block is deflated once."""
    packer = zlib.compressobj(9, wbits=wbits)
    begun = packer.compress(first) + packer.flush(zlib.Z_FULL_FLUSH)
    repeated = packer.compress(block) + packer.flush(zlib.Z_FULL_FLUSH)
    return begun + blocks * repeated + packer.flush()


def bomb_gz(first: bytes, block: bytes, blocks: int) -> bytes:
    return bomb(first, block, blocks, wbits=31)


def bomb_mat(rows: int) -> bytes:
    """Sound variables, and a packed one of that many zeros."""

    def tag(kind: int, size: int) -> bytes:
        return struct.pack("<II", kind, size & 0xFFFFFFFF)

    flags = tag(6, 8) + struct.pack("<II", 6, 0)
    shape = tag(5, 8) + struct.pack("<ii", rows, 1)
    head = flags + shape + tag(1, 5) + b"speed\0\0\0" + tag(9, 8 * rows)
    head = tag(14, len(head) + 8 * rows) + head
    packed = bomb(head, bytes(1 << 20), rows >> 17, wbits=15)
    check = zlib.adler32(head)
    for _ in range(rows >> 17):
        check = zlib.adler32(bytes(1 << 20), check)
    packed = packed[:-4] + struct.pack(">I", check)
    return mat(without="speed") + tag(15, len(packed)) + packed


def claims_trace(path: Path, rows: int) -> bytes:
    """A trace that claims so many rows and stores none of them."""
    import netCDF4

    with netCDF4.Dataset(path, "w") as file:
        group = file.createGroup("steady").createGroup("pi")
        group.createDimension("time", rows)
        for name in columns():
            group.createVariable(name, "f8", ("time",), chunksizes=(1024,), zlib=True)
    return path.read_bytes()


def bomb_parquet(rows: int) -> bytes:
    """So many rows, all of one value."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = io.BytesIO()
    block = pa.table({name: np.zeros(1 << 20) for name in columns()})
    with pq.ParquetWriter(file, block.schema) as writer:
        for _ in range(rows >> 20):
            writer.write_table(block)
    return file.getvalue()


def hostile_mdf(sound: bytes, scale: int) -> list[tuple[str, bytes]]:
    """What is wrong and the content of hostile files, made of a sound one whose links lead to its first data
    group, its channels and its data."""

    def link(content: bytes, block: int, number: int) -> int:
        return int(struct.unpack_from("<Q", content, block + 24 + 8 * number)[0])

    def with_number(content: bytes, place: int, value: int) -> bytes:
        return content[:place] + struct.pack("<Q", value) + content[place + 8 :]

    group = link(sound, 64, 0)
    channels = link(sound, group, 1)
    channel = link(sound, channels, 1)
    zipped = b"DT" + struct.pack("<BBIQ", 0, 0, 0, 24 * ROWS)
    unpacks = bomb(b"", bytes(1 << 20), 5000 // scale, wbits=15)
    block = struct.pack("<4s4xQQ", b"##DZ", 48 + len(unpacks), 0) + zipped + struct.pack("<Q", len(unpacks))
    return [
        ("has a group behind itself", with_number(sound, group + 24, group)),
        ("has channels in a circle", with_number(sound, channel + 24, channel)),
        ("has a channel within itself", with_number(sound, channel + 32, channel)),
        ("claims 1e12 rows", with_number(sound, channels + 24 + 8 * 6 + 8, 10**12)),
        ("unpacks to 5 GB", with_number(sound, group + 24 + 16, len(sound)) + block + unpacks),
    ]


def hostile_files(folder: Path, scale: int) -> list[tuple[str, str, bytes]]:
    """Files that are built to harm: kind, what it does, content. `scale` divides what it unpacks to."""
    heading = ",".join(columns()).encode() + b"\n"
    files = [
        (".npz", "claims 8 TB", claims_npz((1 << 40,))),
        (".npz", "claims a product beyond 64 bits", claims_npz((1 << 40, 1 << 40))),
        (".npz", "unpacks to 1 GiB", bomb_npz((1 << 27) // scale)),
        (".csv.gz", "unpacks to 3 GB of zeros", bomb_gz(b"", bytes(1 << 20), 3000)),
        (".csv.gz", "unpacks to 1 GB of empty lines", bomb_gz(heading, b"\n" * (1 << 20), 1000)),
        (".csv.gz", "unpacks to 1 GB of comments", bomb_gz(b"", b"#\n" * (1 << 19), 1000)),
        (".csv.gz", "unpacks to a row of 1 GB", bomb_gz(heading, b"0," * (1 << 19), 1000)),
        (".mat", "unpacks to 1 GiB", bomb_mat((1 << 27) // scale)),
        (".csv.gz", "unpacks to 200 million rows", bomb_gz(heading, b"0,0,0\n" * (1 << 20), 200 // scale)),
        (".nc", "claims 8 TB", claims_trace(folder / "c.nc", 1 << 40)),
    ]
    with suppress(ImportError):
        files.append((".parquet", "unpacks to 1 GiB", bomb_parquet((1 << 26) // scale)))
    with suppress(ImportError):
        files += [(".mf4", what, content) for what, content in hostile_mdf(mdf(folder / "d.mf4", 0), scale)]
    return files


@dataclass(frozen=True)
class Ending:
    """How a command ended: its exit code, below 0 a signal's; what it wrote on stderr; B that it took."""

    code: int
    err: str
    memory: int

    def fault(self, name: str) -> str:
        """What is wrong with this ending of a command that read this file; empty if nothing is."""
        if self.code in (-signal.SIGALRM, -signal.SIGXCPU):
            return f"still runs after {TIME_MOST} s of the processor, or {WAIT_MOST} s"
        if self.code < 0:
            return f"ended by signal {-self.code}"
        if "Traceback" in self.err:
            return f"traceback: {self.err.strip().splitlines()[-1]}"
        if self.memory > MEMORY_MOST:
            return f"took {self.memory >> 20} MiB"
        lines = self.err.splitlines()
        if self.code == 2 and self.err.endswith(TOO_SHORT):
            return ""  # a sound log, too short for a result
        if self.code == 0 and lines:
            return f"a result, and on stderr: {lines[0]}"
        if self.code == 2 and (len(lines) != 1 or name not in self.err):
            return f"{len(lines)} lines: {self.err!r}"
        return "" if self.code in (0, 2) else f"exit {self.code}: {self.err!r}"


def diagnosed(path: Path) -> Ending:
    """`cogless diagnose` of a file in a fork of this process."""
    said = path.with_name("stderr")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    pid = os.fork()
    if not pid:
        with said.open("wb") as file, open(os.devnull, "wb") as nothing:
            os.dup2(file.fileno(), 2)
            os.dup2(nothing.fileno(), 1)
        signal.alarm(WAIT_MOST)
        resource.setrlimit(resource.RLIMIT_CPU, (TIME_MOST, TIME_MOST + 1))
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        space = 4 * MEMORY_MOST + pages * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (space, space))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        sys.argv = ["cogless", "diagnose", str(path), "--config", str(path.with_name("id.toml"))]
        code = 70
        try:
            from cogless.__main__ import main

            main()
        except SystemExit as end:
            code = int(end.code or 0)
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(code)
    _, status, usage = os.wait4(pid, 0)
    memory = (usage.ru_maxrss - before) << 10
    return Ending(os.waitstatus_to_exitcode(status), said.read_text("utf-8", "replace"), memory)


def cases(folder: Path, count: int, seed: int, scale: int) -> list[tuple[str, str, bytes]]:
    """Kind, what is wrong and content of each file: sound ones, hostile ones, and `count` damaged ones."""
    sound = sound_files(folder)
    made = [(kind, "sound", content) for kind, forms in sound.items() for content in forms]
    made += hostile_files(folder, scale)
    chance = np.random.default_rng(seed)
    kinds = list(sound)
    for number in range(count):
        kind = kinds[number % len(kinds)]
        content = sound[kind][chance.integers(len(sound[kind]))]
        damage = chance.choice([*DAMAGES, "swapped"], p=[0.2, 0.4, 0.15, 0.2, 0.05])
        if damage == "swapped":
            other = [k for k in kinds if k != kind][chance.integers(len(kinds) - 1)]
            made.append((kind, f"swapped with {other}", sound[other][0]))
        else:
            made.append((kind, str(damage), DAMAGES[damage](content, chance)))
    return made


def prepare(columns: Path, scale: int) -> None:
    """Import and build once what each fork would; `scale` divides the largest log."""
    import cogless.cli
    from cogless.identify import config, diagnosis, log_files

    log_files.NUMBERS_MOST //= scale
    log_files.PACKED_MOST //= scale
    assert cogless.cli.app and diagnosis.diagnosed
    config.load(columns)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=560)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scale", type=int, default=1, help="divides the largest log, to be quick")
    parser.add_argument("--keep", type=Path, help="folder for the files that make a fault")
    options = parser.parse_args()
    counts: Counter[str] = Counter()
    faults = 0
    with TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "id.toml").write_text(ID)
        prepare(folder / "id.toml", options.scale)
        for number, (kind, what, content) in enumerate(
            cases(folder, options.cases, options.seed, options.scale)
        ):
            path = folder / f"log{number}{kind}"
            path.write_bytes(content)
            ending = diagnosed(path)
            fault = ending.fault(path.name)
            if what == "sound" and ending.code and kind != ".mat":
                fault = fault or f"a sound file is refused: {ending.err.strip()}"
            if fault:
                faults += 1
                print(f"{path.name}: {what}: {fault}", flush=True)
                if options.keep:
                    (options.keep / path.name).write_bytes(content)
            outcome = "fault" if fault else "refused in a line" if ending.code else "result"
            counts[f"{kind}: {outcome}"] += 1
            path.unlink()
    for outcome, number in sorted(counts.items()):
        print(f"{outcome}: {number}")
    print(f"{counts.total()} files, {faults} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
