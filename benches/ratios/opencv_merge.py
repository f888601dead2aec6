"""Times OpenCV's MergeDebevec on the pictures that the bench wrote.

Arguments: exposure times in seconds, each followed by its PNG. Prints the best and the median time in milliseconds
and the number of threads, or nothing but "missing" where there is no OpenCV.
"""

import sys
import time

try:
    import cv2
    import numpy
except ImportError:
    print("missing")
    sys.exit(0)

times_s = numpy.array([float(t) for t in sys.argv[1::2]], dtype=numpy.float32)
pictures = [cv2.imread(file) for file in sys.argv[2::2]]
merge = cv2.createMergeDebevec()
measured = []
for _ in range(21):
    start = time.perf_counter()
    merge.process(pictures, times_s)
    measured.append(1e3 * (time.perf_counter() - start))
measured.sort()
print(f"{measured[0]:.3f} {measured[len(measured) // 2]:.3f} {cv2.getNumThreads()} {cv2.__version__}")
