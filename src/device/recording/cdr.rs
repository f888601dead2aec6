//! ROS 2's messages: CDR (OMG's Common Data Representation) by hand, for the few types that matter here. Pure; any bytes give a
//! message or an error.

use super::lens::CalibrationFields;
use crate::model::{imu::ImuSample, time::Timestamp};

/// A message of which a part has been read. Numbers lie at multiples of their size, counted from behind the first four bytes.
pub(super) struct Cdr<'a> {
    bytes: &'a [u8],
    at: usize,
    is_little: bool,
}

impl<'a> Cdr<'a> {
    /// Reads the head of four bytes.
    pub(super) fn new(message: &'a [u8]) -> Result<Self, String> {
        let (head, bytes) = message.split_first_chunk::<4>().ok_or("shorter than a CDR message's head")?;
        match head {
            [0, kind @ 0..=1, ..] => Ok(Self { bytes, at: 0, is_little: *kind == 1 }),
            [a, b, ..] => Err(format!("CDR kind {a:02x} {b:02x}: must be 00 00 or 00 01 (plain CDR)")),
        }
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let start = self.at.next_multiple_of(N);
        let taken = self.bytes.get(start..).and_then(|rest| rest.first_chunk::<N>()).copied();
        let mut taken = taken
            .ok_or_else(|| format!("it ends after {} bytes, within a number at {start}", self.bytes.len()))?;
        self.at = start + N;
        if !self.is_little {
            taken.reverse();
        }
        Ok(taken)
    }

    fn u8(&mut self) -> Result<u8, String> {
        Ok(self.take::<1>()?[0])
    }

    fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.take()?))
    }

    fn f64(&mut self) -> Result<f64, String> {
        Ok(f64::from_le_bytes(self.take()?))
    }

    fn f64s(&mut self, count: usize) -> Result<Vec<f64>, String> {
        let left = self.bytes.len().saturating_sub(self.at);
        if count > left / 8 {
            return Err(format!("a list of {count} numbers in {left} bytes"));
        }
        (0..count).map(|_| self.f64()).collect()
    }

    /// Bytes after their number.
    fn bytes(&mut self) -> Result<&'a [u8], String> {
        let length = self.u32()? as usize;
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let taken = rest
            .get(..length)
            .ok_or_else(|| format!("{length} bytes are announced, {} are there", rest.len()))?;
        self.at += length;
        Ok(taken)
    }

    /// Text, which ends with a 0.
    fn text(&mut self) -> Result<&'a str, String> {
        let bytes = self.bytes()?;
        std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes))
            .map_err(|_e| "a text is not UTF-8".into())
    }

    /// `std_msgs/msg/Header`: its time.
    fn header(&mut self) -> Result<Timestamp, String> {
        let seconds = i64::from(self.u32()? as i32);
        let nanoseconds = i64::from(self.u32()?);
        self.text()?;
        Ok(Timestamp(seconds * 1_000_000_000 + nanoseconds))
    }
}

/// `sensor_msgs/msg/CameraInfo`.
pub(super) fn camera_info(message: &[u8]) -> Result<CalibrationFields, String> {
    let mut cdr = Cdr::new(message)?;
    cdr.header()?;
    let (height, width) = (cdr.u32()?, cdr.u32()?);
    let distortion_model = cdr.text()?.to_owned();
    let count = cdr.u32()? as usize;
    let d = cdr.f64s(count)?;
    let k = cdr.f64s(9)?;
    Ok(CalibrationFields { width, height, distortion_model, d, k })
}

/// `sensor_msgs/msg/Imu`, without its covariances.
pub(super) fn imu(message: &[u8]) -> Result<ImuSample, String> {
    let mut cdr = Cdr::new(message)?;
    let t = cdr.header()?;
    // Orientation and its covariance.
    cdr.f64s(4 + 9)?;
    let three = |cdr: &mut Cdr<'_>| Ok::<_, String>([cdr.f64()?, cdr.f64()?, cdr.f64()?]);
    let gyro_rad_s = three(&mut cdr)?;
    cdr.f64s(9)?;
    let accel_m_s2 = three(&mut cdr)?;
    Ok(ImuSample { t, gyro_rad_s, accel_m_s2 })
}

/// `sensor_msgs/msg/CompressedImage`: its time, format and data.
pub(super) fn compressed_image(message: &[u8]) -> Result<(Timestamp, &str, &[u8]), String> {
    let mut cdr = Cdr::new(message)?;
    Ok((cdr.header()?, cdr.text()?, cdr.bytes()?))
}

/// `sensor_msgs/msg/Image`.
pub(super) struct RosImage<'a> {
    pub(super) t: Timestamp,
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) encoding: &'a str,
    pub(super) is_big_endian: bool,
    pub(super) step: u32,
    pub(super) data: &'a [u8],
}

/// Reads a `sensor_msgs/msg/Image`.
pub(super) fn image(message: &[u8]) -> Result<RosImage<'_>, String> {
    let mut cdr = Cdr::new(message)?;
    let t = cdr.header()?;
    let (height, width) = (cdr.u32()?, cdr.u32()?);
    let encoding = cdr.text()?;
    let is_big_endian = cdr.u8()? != 0;
    let step = cdr.u32()?;
    Ok(RosImage { t, width, height, encoding, is_big_endian, step, data: cdr.bytes()? })
}
