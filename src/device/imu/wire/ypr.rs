//! Text lines `#YPR=yaw,pitch,roll` in degrees, fused by the sensor.
//!
//! Source: the Razor AHRS firmware's documentation: x ahead, y right, z down; angles turn about z, then y, then x. The lines
//! have no checksum: three numbers with as many decimals each, angles within their ranges, and the gates stand in for it.

use super::resync::WireLook;
use crate::imu::sample::{WireSample, z_up_from_yaw_pitch_roll};
use crate::model::time::Timestamp;
use glam::DQuat;

/// How every line begins.
const HEAD: &[u8] = b"#YPR=";
/// The longest line with its end, bytes.
const LONGEST: usize = 48;

/// Looks for a line at the beginning of these bytes.
pub fn look(bytes: &[u8], arrival: Timestamp) -> WireLook {
    if bytes.iter().zip(HEAD).any(|(byte, head)| byte != head) {
        return WireLook::Nothing;
    }
    let Some(end) = bytes.iter().take(LONGEST).position(|byte| *byte == b'\n') else {
        let is_broken = bytes.len() >= LONGEST || bytes[1..].contains(&b'#');
        return if is_broken { WireLook::Nothing } else { WireLook::More };
    };
    let angles = bytes.get(HEAD.len()..end).and_then(|line| std::str::from_utf8(line).ok()).and_then(angles);
    let Some([yaw, pitch, roll]) = angles else { return WireLook::Nothing };
    let down_from_sensor = z_up_from_yaw_pitch_roll(yaw, pitch, roll);
    let up_from_down = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
    let sample =
        WireSample { orientation: Some(up_from_down * down_from_sensor), ..WireSample::empty(arrival) };
    WireLook::Sample(end + 1, sample)
}

/// Yaw, pitch and roll in degrees.
fn angles(line: &str) -> Option<[f64; 3]> {
    let mut fields = line.trim_end_matches('\r').split(',');
    let mut angles = [0.0; 3];
    let mut decimals = None;
    for (angle, most) in angles.iter_mut().zip([180.0, 90.0, 180.0]) {
        let field = fields.next()?;
        let (whole, fraction) = field.split_once('.').unwrap_or((field, ""));
        let digits = whole.strip_prefix('-').unwrap_or(whole);
        let is_number = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
        if digits.is_empty() || digits.len() > 3 || !is_number(digits) || !is_number(fraction) {
            return None;
        }
        if *decimals.get_or_insert(fraction.len()) != fraction.len() {
            return None;
        }
        *angle = field.parse().ok().filter(|degrees: &f64| degrees.abs() <= most)?;
    }
    fields.next().is_none().then_some(angles)
}
