//! Words after `capture`.

/// How to take frames.
pub struct Options {
    pub device: String,
    pub size: (u32, u32),
    pub frames: usize,
    /// Where the list of frames goes.
    pub out: String,
    pub one: bool,
    pub until_gone: bool,
    /// The camera falls silent, and that is how it ends.
    pub silent: bool,
    /// Frames lost that the driver counted, and all that the camera counted.
    pub lost: (u32, u32),
    /// Frames from a setting to the first frame that has it, least and most.
    pub lag: Option<(usize, usize)>,
}

fn two<T: std::str::FromStr>(text: &str, between: char) -> Option<(T, T)> {
    let (a, b) = text.split_once(between)?;
    Some((a.parse().ok()?, b.parse().ok()?))
}

impl Options {
    /// Reads `DEVICE key=value.. one gone silent`.
    pub fn parse(words: &[String]) -> Result<Self, String> {
        let mut options = Self {
            device: words.first().cloned().ok_or("which device?")?,
            size: (320, 240),
            frames: 20,
            out: String::new(),
            one: false,
            until_gone: false,
            silent: false,
            lost: (0, 0),
            lag: None,
        };
        for word in &words[1..] {
            let (key, value) = word.split_once('=').unwrap_or((word, ""));
            let bad = || format!("\"{word}\" is no option");
            match key {
                "size" => options.size = two(value, 'x').ok_or_else(bad)?,
                "frames" => options.frames = value.parse().ok().ok_or_else(bad)?,
                "out" => value.clone_into(&mut options.out),
                "one" => options.one = true,
                "gone" => options.until_gone = true,
                "silent" => options.silent = true,
                "lost" => options.lost = two(value, ',').ok_or_else(bad)?,
                "lag" => options.lag = Some(two(value, '-').ok_or_else(bad)?),
                _ => return Err(bad()),
            }
        }
        Ok(options)
    }
}
