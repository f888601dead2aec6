//! The picture's own curve, both ways.

/// Buckets of light that say where in the table to look.
const BUCKETS: usize = 2048;

/// Light of each value, and values of any light. Keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct Curve {
    light: Vec<f32>,
    /// For each bucket the last value whose light is not above its lower end.
    first: Vec<u8>,
    per_light: f32,
}

impl Curve {
    /// Takes the light of each value, which must rise.
    pub fn take(&mut self, linear_of_value: &[f32; 256]) {
        if self.light == linear_of_value {
            return;
        }
        self.light.clear();
        self.light.extend_from_slice(linear_of_value);
        let (low, high) = (linear_of_value[0], linear_of_value[255]);
        self.per_light = BUCKETS as f32 / (high - low);
        self.first.clear();
        self.first.extend((0..BUCKETS).map(|bucket| {
            let least = low + bucket as f32 / self.per_light;
            linear_of_value.partition_point(|t| *t <= least).saturating_sub(1) as u8
        }));
    }

    /// Light of a value.
    pub fn of(&self, value: u8) -> f32 {
        self.light[usize::from(value)]
    }

    /// Light of a value between two; clipped.
    pub fn between(&self, value: f32) -> f32 {
        let low = (value.max(0.0) as usize).min(254);
        let step = self.light[low + 1] - self.light[low];
        self.light[low] + step * (value - low as f32).clamp(0.0, 1.0)
    }

    /// Value and slope (values for a unit of light) of some light; clipped as the camera clips.
    pub fn encode(&self, light: f32) -> (f32, f32) {
        let table = &self.light[..];
        if light >= table[255] {
            return (255.0, 0.0);
        }
        let bucket = ((light - table[0]) * self.per_light).max(0.0) as usize;
        let mut low = usize::from(self.first[bucket.min(BUCKETS - 1)]).min(254);
        while low < 254 && table[low + 1] <= light {
            low += 1;
        }
        let value = low as f32 + (light - table[low]) / (table[low + 1] - table[low]);
        // Over two steps: one alone makes the slope jump.
        let (from, to) = (low.saturating_sub(1), low + 2);
        let to = to.min(255);
        let slope = (to - from) as f32 / (table[to] - table[from]);
        (value.max(0.0), slope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back_from_their_light() {
        let mut curve = Curve::default();
        curve.take(&crate::track::edges::srgb_table());
        for value in 0..255u8 {
            let (back, slope) = curve.encode(curve.of(value));
            assert!((back - f32::from(value)).abs() < 1e-3 && slope > 0.0, "{value}: {back}");
            let (middle, _) = curve.encode(curve.between(f32::from(value) + 0.5));
            assert!((middle - f32::from(value) - 0.5).abs() < 1e-3, "{value}: {middle}");
        }
        assert_eq!(curve.encode(2.0), (255.0, 0.0));
        assert_eq!(curve.encode(-1.0).0, 0.0);
    }
}
