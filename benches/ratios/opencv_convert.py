"""Times OpenCV's conversion of a camera's bytes to linear RGB in 32-bit floats.

Arguments: the format, width, height, and the file with the bytes. Prints the best and the median time in milliseconds and
the number of threads, or nothing but "missing" where there is no OpenCV.
"""

import sys
import time

try:
    import cv2
    import numpy
except ImportError:
    print("missing")
    sys.exit(0)

form, width, height = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
data = numpy.fromfile(sys.argv[4], dtype=numpy.uint8)
table = ((numpy.arange(256, dtype=numpy.float32) / 255.0) ** 2.2).astype(numpy.float32)
table = numpy.repeat(table.reshape(1, 256, 1), 3, axis=2)


def convert():
    if form == "YUYV":
        rgb = cv2.cvtColor(data.reshape(height, width, 2), cv2.COLOR_YUV2RGB_YUYV)
    elif form == "NV12":
        rgb = cv2.cvtColor(data.reshape(height * 3 // 2, width), cv2.COLOR_YUV2RGB_NV12)
    elif form == "MJPEG":
        rgb = cv2.imdecode(data, cv2.IMREAD_COLOR)
    else:
        values = data.view(numpy.uint16).reshape(height, width)
        return cv2.cvtColor(values, cv2.COLOR_BayerRG2RGB).astype(numpy.float32) * (1.0 / 1023.0)
    return cv2.LUT(rgb, table)


measured = []
for _ in range(31):
    start = time.perf_counter()
    convert()
    measured.append(1e3 * (time.perf_counter() - start))
measured.sort()
print(f"{measured[0]:.3f} {measured[len(measured) // 2]:.3f} {cv2.getNumThreads()} {cv2.__version__}")
