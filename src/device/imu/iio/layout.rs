//! Records of an IIO buffer: which channel stands where. Pure.
//!
//! Source: the Linux kernel's documentation of IIO buffers, `Documentation/ABI/testing/sysfs-bus-iio`: channels stand in order of
//! their index, each at a multiple of its own size, the record's size a multiple of the largest.

/// The most channels of a device, and the longest record in bytes.
const MOST_CHANNELS: usize = 32;
const LONGEST: usize = 1024;

/// A channel's place and form.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanChannel {
    /// As in sysfs, e.g. `in_accel_x`.
    pub name: String,
    /// First byte in the record.
    pub offset: usize,
    /// Numbers in it (a quaternion has 4).
    pub repeat: usize,
    form: Form,
}

/// `le:s16/32X4>>0`
#[derive(Clone, Copy, Debug, PartialEq)]
struct Form {
    is_big_endian: bool,
    is_signed: bool,
    bits: u32,
    stored_bytes: usize,
    repeat: usize,
    shift: u32,
}

impl Form {
    fn parse(text: &str) -> Option<Self> {
        let (endian, rest) = text.trim().split_once(':')?;
        let is_big_endian = match endian {
            "le" => false,
            "be" => true,
            _ => return None,
        };
        let is_signed = match rest.get(..1)? {
            "s" => true,
            "u" => false,
            _ => return None,
        };
        let (bits, rest) = rest.get(1..)?.split_once('/')?;
        let (stored, shift) = rest.split_once(">>")?;
        let (stored, repeat) = stored.split_once('X').unwrap_or((stored, "1"));
        let (bits, stored, shift): (u32, u32, u32) =
            (bits.parse().ok()?, stored.parse().ok()?, shift.parse().ok()?);
        let repeat: usize = repeat.parse().ok()?;
        let is_sound = matches!(stored, 8 | 16 | 32 | 64)
            && bits >= 1
            && bits.checked_add(shift).is_some_and(|all| all <= stored)
            && (1..=16).contains(&repeat);
        let form = Self { is_big_endian, is_signed, bits, stored_bytes: stored as usize / 8, repeat, shift };
        is_sound.then_some(form)
    }
}

/// A record.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout {
    /// In the order of the record.
    pub channels: Vec<ScanChannel>,
    /// The record's length.
    pub bytes: usize,
}

impl Layout {
    /// Takes name, index and type of each enabled channel, as sysfs says them.
    pub fn new(mut channels: Vec<(String, u32, String)>) -> Result<Self, String> {
        if channels.is_empty() || channels.len() > MOST_CHANNELS {
            return Err(format!("{} channels are enabled, must be 1 to {MOST_CHANNELS}", channels.len()));
        }
        channels.sort_by_key(|(_, index, _)| *index);
        let mut layout = Self::default();
        let mut largest = 1;
        for (name, _, text) in channels {
            let form = Form::parse(&text)
                .ok_or_else(|| format!("{name}: type \"{}\" must be like le:s16/32X4>>0", text.trim()))?;
            let size = form.stored_bytes * form.repeat;
            largest = largest.max(size);
            let offset = layout.bytes.next_multiple_of(size);
            layout.bytes = offset + size;
            layout.channels.push(ScanChannel { name, offset, repeat: form.repeat, form });
        }
        layout.bytes = layout.bytes.next_multiple_of(largest);
        if layout.bytes > LONGEST {
            return Err(format!("records of {} bytes, must be at most {LONGEST}", layout.bytes));
        }
        Ok(layout)
    }

    /// The time of a record, by the channel of this name. Kernels put it into the record's last eight bytes, also where a channel
    /// of 16 bytes (a quaternion) leaves room before them and `sysfs` tells of an earlier place; that is read where the last is 0.
    pub fn time(&self, name: &str, record: &[u8]) -> Option<i64> {
        let channel = self.channel(name)?;
        let last = channel.form.read_at(record, self.bytes.checked_sub(channel.form.stored_bytes)?);
        last.filter(|time| *time != 0).or_else(|| channel.read(record, 0))
    }

    /// The channel of a name.
    pub fn channel(&self, name: &str) -> Option<&ScanChannel> {
        self.channels.iter().find(|channel| channel.name == name)
    }
}

impl ScanChannel {
    /// Number `k` of the channel in a record; `None` beyond the record's end.
    pub fn read(&self, record: &[u8], k: usize) -> Option<i64> {
        if k < self.repeat {
            self.form.read_at(record, self.offset + k * self.form.stored_bytes)
        } else {
            None
        }
    }
}

impl Form {
    /// The value whose bytes begin here; `None` beyond the record's end.
    fn read_at(self, record: &[u8], at: usize) -> Option<i64> {
        let Self { stored_bytes, bits, shift, .. } = self;
        let stored = record.get(at..at.checked_add(stored_bytes)?)?;
        let fold = |all: u64, byte: &u8| all << 8 | u64::from(*byte);
        let all =
            if self.is_big_endian { stored.iter().fold(0, fold) } else { stored.iter().rev().fold(0, fold) };
        let value = (all >> shift) << (64 - bits);
        Some(if self.is_signed {
            value.cast_signed() >> (64 - bits)
        } else {
            (value >> (64 - bits)).cast_signed()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn channel(name: &str, index: u32, form: &str) -> (String, u32, String) {
        (name.into(), index, form.into())
    }

    #[test]
    fn records_are_laid_out_as_the_kernel_does() {
        let layout = Layout::new(vec![
            channel("in_timestamp", 1, "le:s64/64>>0\n"),
            channel("in_rot_quaternion", 0, "le:s32/32X4>>0"),
        ]);
        let layout = layout.unwrap();
        assert_eq!((layout.bytes, layout.channel("in_timestamp").unwrap().offset), (32, 16));
        let mut record = [0u8; 32];
        record[24..].copy_from_slice(&77i64.to_le_bytes());
        assert_eq!(layout.time("in_timestamp", &record), Some(77), "Linux 6.1 behind a quaternion");
        record[16..].fill(0);
        record[16] = 9;
        assert_eq!(layout.time("in_timestamp", &record), Some(9), "where sysfs says");
        let layout = Layout::new(vec![
            channel("in_accel_x", 0, "be:s12/16>>4"),
            channel("in_accel_y", 1, "le:u8/8>>0"),
            channel("in_timestamp", 2, "le:s64/64>>0"),
        ]);
        let layout = layout.unwrap();
        assert_eq!((layout.bytes, layout.channels[2].offset), (16, 8));
        let mut record = [0u8; 16];
        (record[0], record[1], record[2]) = (0x80, 0x1F, 200);
        assert_eq!(layout.channels[0].read(&record, 0), Some(-2047));
        assert_eq!(layout.channels[1].read(&record, 0), Some(200));
        assert_eq!(layout.channels[0].read(&record, 1), None);
        assert_eq!(layout.channels[2].read(&record[..9], 0), None);
    }

    #[test]
    fn what_is_no_type_is_told() {
        for form in
            ["", "le:s16/16", "le:s17/16>>0", "xe:s16/16>>0", "le:s16/16X0>>0", "le:s0/8>>0", "le:s16/24>>0"]
        {
            assert!(
                Layout::new(vec![channel("in_accel_x", 0, form)]).unwrap_err().contains("in_accel_x"),
                "{form}"
            );
        }
        assert!(Layout::new(Vec::new()).is_err());
    }

    proptest! {
        #[test]
        fn any_types_and_records_are_read_or_refused(
            forms in prop::collection::vec("(le|be):[su][0-9]{1,2}/(8|16|32|64)(X[0-9])?>>[0-9]", 1..8),
            record in prop::collection::vec(any::<u8>(), 0..300),
        ) {
            let channels = forms.iter().enumerate().map(|(k, form)| channel("c", k as u32, form)).collect();
            if let Ok(layout) = Layout::new(channels) {
                for channel in &layout.channels {
                    (0..17).for_each(|k| { channel.read(&record, k); });
                }
            }
        }
    }
}
