"""Makes the TIFF files of this folder with tifffile and imagecodecs, as ImageJ, Micro-Manager, OpenPIV and cameras
write them. Count of pixel (x, y) of plane z, time t, channel c: 1000 c + 100 t + 10 z + x + 8 y (8 bit: less 750 c).
"""

import struct
from pathlib import Path

import numpy as np
import tifffile

HERE = Path(__file__).parent
Z, Y, X = 7, 3, 8


def stack(times=1, channels=1):
    t, c, z, y, x = np.ogrid[:times, :channels, :Z, :Y, :X]
    return (1000 * c + 100 * t + 10 * z + x + 8 * y).astype("u2")


def write(name, data, **options):
    tifffile.imwrite(HERE / name, data, photometric=options.pop("photometric", "minisblack"), **options)


def ome(pixels, inside="<TiffData/>"):
    return (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0"><Pixels '
        f'ID="Pixels:0" Type="uint16" SizeX="{X}" SizeY="{Y}" {pixels}>{inside}</Pixels></Image></OME>'
    )


um = {"spacing": 2.0, "unit": "um"}
write("imagej_tz.tif", stack(3)[:, 0], imagej=True, metadata={"axes": "TZYX", **um})
write("imagej_zc.tif", stack(1, 2)[0].swapaxes(0, 1), imagej=True, metadata={"axes": "ZCYX", **um})
write("imagej_t.tif", stack()[0, 0], imagej=True, metadata={"axes": "TYX", **um})
write("imagej_large.tif", stack()[0, 0], imagej=True, truncate=True, byteorder=">", metadata={"axes": "ZYX", **um})
lines = "ImageJ=1.53t\nimages=7\nslices=7\nunit=micron\nzunit=nm\nspacing=2000.0\n"
write("imagej_nm.tif", stack()[0, 0], metadata=None, description=lines)
write("tifffile_zt.tif", stack(3)[:, 0].swapaxes(0, 1), metadata={"axes": "ZTYX"})
write("ome_zt.ome.tif", stack(3)[:, 0].swapaxes(0, 1), metadata={"axes": "ZTYX", "PhysicalSizeZ": 2.0})
for name, step, position in (
    ("uneven", "2", lambda z: z * z / 4),
    ("falling", "2", lambda z: -2 * z),
    ("fixed", "2", lambda z: 5),
    ("only", "", lambda z: 2 * z),
):
    planes = "".join(f'<Plane TheC="0" TheT="0" TheZ="{z}" PositionZ="{position(z)}" PositionZUnit="&#181;m"/>' for z in range(Z))
    size = f"PhysicalSizeZ='{step}' " if step else ""
    text = ome(f'DimensionOrder="XYCZT" SizeC="1" SizeZ="{Z}" SizeT="1" {size}', "<TiffData/>" + planes)
    write(f"ome_{name}.ome.tif", stack()[0, 0], metadata=None, description=text)
# Two files of a set, as Micro-Manager splits them.
blocks = "".join(
    f'<TiffData FirstC="0" FirstZ="{z}" FirstT="0" IFD="{z % 4}" PlaneCount="1"><UUID FileName="part_{z // 4}.ome.tif">'
    f"urn:uuid:{z // 4}</UUID></TiffData>"
    for z in range(Z)
)
text = ome(f'DimensionOrder="XYCZT" SizeC="1" SizeZ="{Z}" SizeT="1" PhysicalSizeZ="2"', blocks)
(HERE / "set").mkdir(exist_ok=True)
for part in range(2):
    write(f"set/part_{part}.ome.tif", stack()[0, 0, 4 * part : 4 * part + 4], metadata=None, description=text)
# Ways to store the planes.
write("white.tif", stack()[0, 0], photometric="miniswhite", metadata=None)
write("zstd.tif", stack()[0, 0], compression="zstd", metadata=None)
gray = np.arange(256, dtype="u2") * 257
write("palette.tif", stack()[0, 0].astype("u1"), photometric="palette", colormap=np.stack([gray] * 3), metadata=None)
write("colors.tif", stack()[0, 0].astype("u1"), photometric="palette", colormap=np.stack([gray, gray[::-1], gray]), metadata=None)
write("latin1.tif", stack()[0, 0], metadata=None, description=lines.replace("micron\nzunit=nm\nspacing=2000.0", "\xb5m\nspacing=2.0").encode("latin-1"))


def packed(name, bits, order):
    """Rows of numbers of `bits` bit without gaps, the highest bit first; tifffile writes none of that kind."""
    out = bytearray(struct.pack(order + "2sHI", {"<": b"II", ">": b"MM"}[order], 42, 8))
    planes = stack()[0, 0]
    for k, plane in enumerate(planes):
        rows = [int("".join(f"{count:0{bits}b}" for count in row).ljust(-(-X * bits // 8) * 8, "0"), 2) for row in plane]
        data = b"".join(row.to_bytes(-(-X * bits // 8), "big") for row in rows)
        tags = [(256, X), (257, Y), (258, bits), (259, 1), (262, 1), (273, 0), (278, Y), (279, len(data))]
        at = len(out) + 2 + 12 * len(tags) + 4
        out += struct.pack(order + "H", len(tags))
        for tag, value in tags:
            out += struct.pack(order + "HHII", tag, 4, 1, at if tag == 273 else value)
        after = at + len(data) + len(data) % 2
        out += struct.pack(order + "I", after if k + 1 < Z else 0) + data + b"\0" * (len(data) % 2)
    (HERE / name).write_bytes(out)


packed("packed_12.tif", 12, "<")
packed("packed_10.tif", 10, ">")
