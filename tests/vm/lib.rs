//! What both sides of `make test-vm` must agree on: the strip in every picture that tells its number and its true
//! exposure, the digest of a picture, and the samples of the inertial sensor.

/// Columns that one bit of the strip takes.
const BIT_COLUMNS: usize = 8;
/// Rows of the strip, at the top of the picture.
pub const STRIP_ROWS: usize = 8;
/// Bits of the strip: number, exposure, check.
const BITS: usize = 40;
/// Luma of a bit that is not set and of one that is.
const LUMA: [u8; 2] = [16, 235];

/// What a strip tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strip {
    /// Counts the pictures that the camera made, modulo 65536.
    pub number: u16,
    /// True exposure time in units of 100 us.
    pub exposure: u16,
}

impl Strip {
    fn check(self) -> u8 {
        let [a, b] = self.number.to_le_bytes();
        let [c, d] = self.exposure.to_le_bytes();
        (a ^ b.rotate_left(1) ^ c.rotate_left(2) ^ d.rotate_left(3)) ^ 0xa5
    }

    fn bits(self) -> u64 {
        u64::from(self.number) | u64::from(self.exposure) << 16 | u64::from(self.check()) << 32
    }

    /// Writes the strip into a picture in YUYV, at least 320 pixels wide.
    pub fn write(self, yuyv: &mut [u8], width: usize) {
        for row in yuyv.chunks_exact_mut(2 * width).take(STRIP_ROWS) {
            for (x, pixel) in row.chunks_exact_mut(2).take(BITS * BIT_COLUMNS).enumerate() {
                pixel.copy_from_slice(&[LUMA[(self.bits() >> (x / BIT_COLUMNS) & 1) as usize], 128]);
            }
        }
    }

    /// Reads the strip in the middle of its row, from what is bright at a column. `None` where it does not hold together.
    pub fn read(is_bright: impl Fn(usize) -> bool) -> Option<Self> {
        let bits = (0..BITS)
            .fold(0_u64, |bits, bit| bits | u64::from(is_bright(bit * BIT_COLUMNS + BIT_COLUMNS / 2)) << bit);
        let strip = Self { number: bits as u16, exposure: (bits >> 16) as u16 };
        (strip.bits() == bits).then_some(strip)
    }

    /// Reads the strip of a picture in YUYV.
    pub fn of_yuyv(yuyv: &[u8], width: usize) -> Option<Self> {
        let row = yuyv.get(STRIP_ROWS / 2 * 2 * width..)?;
        Self::read(|x| row.get(2 * x).is_some_and(|luma| *luma >= 128))
    }
}

/// Digest of bytes (FNV-1a, 64 bits): enough to tell pictures apart that nobody makes on purpose.
pub fn digest(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3))
}

/// Bytes of one report of the inertial sensor.
pub const REPORT_BYTES: usize = 21;

/// One sample of the inertial sensor, by rule from its counter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// Counts the samples.
    pub counter: u32,
    /// The device's own time, microseconds.
    pub time_us: u32,
    /// Turning rate about three axes, then acceleration along them.
    pub values: [i16; 6],
}

impl Sample {
    /// First byte of every report.
    const KIND: u8 = 1;
    /// The sensor gives 200 samples a second of its own time.
    const PERIOD_US: u32 = 5000;

    /// The sample with this counter.
    pub fn by_rule(counter: u32) -> Self {
        let value = |axis: u32| (counter.wrapping_mul((axis + 3) * 37) % 4001) as i16 - 2000;
        Self {
            counter,
            time_us: counter.wrapping_mul(Self::PERIOD_US),
            values: [0, 1, 2, 3, 4, 5].map(value),
        }
    }

    /// Kind, counter, time, six values; little-endian.
    pub fn report(self) -> [u8; REPORT_BYTES] {
        let mut report = [0; REPORT_BYTES];
        report[0] = Self::KIND;
        report[1..5].copy_from_slice(&self.counter.to_le_bytes());
        report[5..9].copy_from_slice(&self.time_us.to_le_bytes());
        for (place, value) in report[9..].chunks_exact_mut(2).zip(self.values) {
            place.copy_from_slice(&value.to_le_bytes());
        }
        report
    }

    /// Reads a report; `None` where it is none, or not what the rule says.
    pub fn of_report(report: &[u8]) -> Option<Self> {
        let counter = report.get(1..5)?.try_into().ok().map(u32::from_le_bytes)?;
        let sample = Self::by_rule(counter);
        (sample.report() == report).then_some(sample)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_reports_are_read_back() {
        let strip = Strip { number: 40_961, exposure: 9_999 };
        let mut picture = vec![77; 2 * 320 * 240];
        strip.write(&mut picture, 320);
        assert_eq!(Strip::of_yuyv(&picture, 320), Some(strip));
        picture[2 * (STRIP_ROWS / 2 * 320 + 4)] ^= 0xff;
        assert_eq!(Strip::of_yuyv(&picture, 320), None, "one bit is wrong");
        let sample = Sample::by_rule(123_456);
        assert_eq!(Sample::of_report(&sample.report()), Some(sample));
        assert_eq!(Sample::of_report(&[1; REPORT_BYTES]), None);
    }
}
