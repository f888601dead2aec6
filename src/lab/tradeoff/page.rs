//! One page that needs nothing else: plots, tables, and for each point its picture beside the truth.

use super::{measure::Measured, plot::FrontPlot};
use crate::assets::error::AssetError;
use crate::model::image::{Image, Rgb8Image};
use crate::page::html::{escaped, picture_link};
use std::fmt::Write;

/// Pictures are at most so wide.
const WIDE: usize = 320;
const JPEG_QUALITY: u8 = 84;

/// One subject's part.
pub struct SubjectPart<'a> {
    /// What is drawn of it: error against time.
    pub plot: FrontPlot<'a>,
    /// The truth as it is shown.
    pub truth: Rgb8Image,
    /// The place without virtual objects, as the truth has it.
    pub without: Rgb8Image,
    /// For people: where the truth comes from, what is flat.
    pub notes: Vec<String>,
}

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;max-width:1080px;margin:24px auto;padding:0 16px;color:#222}\
svg{max-width:100%;height:auto}h1{font-size:24px}h2{font-size:19px;margin-top:36px}table{border-collapse:collapse;font-size:13px}\
td,th{padding:3px 10px;text-align:right;border-bottom:1px solid #ddd}td:first-child,th:first-child,td:last-child,th:last-child{text-align:left}\
.shot{display:flex;gap:8px;flex-wrap:wrap;align-items:flex-start}.shot figure{margin:0}.shot img{display:block;max-width:320px}\
figcaption{font-size:12px;color:#666}circle[data-point]{cursor:pointer}circle[data-point]:hover{stroke:#000;stroke-width:2}\
.note{color:#666;font-size:13px}";

/// Shows the point that is chosen; the page says how many it has once it stands.
const SCRIPT: &str = "for(const part of document.querySelectorAll('section')){\
const shots=JSON.parse(part.querySelector('script').textContent);\
const show=i=>{const s=shots[i];if(!s)return;part.querySelector('.name').textContent=s.name;\
part.querySelector('.ours').src=s.ours;part.querySelector('.flip').src=s.flip;};\
part.querySelectorAll('circle[data-point]').forEach(c=>c.addEventListener('click',()=>show(c.dataset.point)));\
part.querySelectorAll('tr[data-point]').forEach(c=>{c.style.cursor='pointer';c.addEventListener('click',()=>show(c.dataset.point));});\
show(part.dataset.first);part.dataset.shots=Object.keys(shots).length;}\
document.body.dataset.ready=document.querySelectorAll('section[data-shots]').length;";

/// The page. `head` is a table for all subjects together.
///
/// # Errors
/// A picture that cannot be encoded.
pub fn page(title: &str, head: &str, parts: &[SubjectPart<'_>]) -> Result<String, AssetError> {
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}</title>\
         <meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style></head><body>\n<h1>{0}</h1>\n{head}\n",
        escaped(title)
    );
    for part in parts {
        let first = part.plot.defaults.or(part.plot.front.last().copied()).unwrap_or(0);
        let _ = writeln!(
            html,
            "<section data-first=\"{first}\"><h2>{}</h2>\n{}",
            escaped(part.plot.title),
            part.plot.svg()
        );
        for note in &part.notes {
            let _ = writeln!(html, "<p class=\"note\">{}</p>", escaped(note));
        }
        let _ = writeln!(
            html,
            "<p>Choose a point: <b class=\"name\"></b></p><div class=\"shot\">\
             <figure><img class=\"ours\" alt=\"the picture\"><figcaption>half-light</figcaption></figure>\
             <figure><img src=\"{}\" alt=\"the truth\"><figcaption>truth</figcaption></figure>\
             <figure><img src=\"{}\" alt=\"the place\"><figcaption>without the objects</figcaption></figure>\
             <figure><img class=\"flip\" alt=\"the difference\"><figcaption>FLIP: black = none</figcaption></figure></div>",
            picture(&part.truth)?,
            picture(&part.without)?
        );
        html.push_str(&table(&part.plot));
        let mut shots = serde_json::Map::new();
        for (i, m) in part.plot.points.iter().enumerate() {
            let [ours, flip] = &m.pictures;
            shots.insert(
                i.to_string(),
                serde_json::json!({ "name": about(m), "ours": picture(ours)?, "flip": picture(flip)? }),
            );
        }
        // No text within may end the script.
        let shots = serde_json::Value::Object(shots).to_string().replace("</", "<\\/");
        let _ = writeln!(html, "<script type=\"application/json\">{shots}</script></section>");
    }
    let _ = writeln!(html, "<script>{SCRIPT}</script></body></html>");
    Ok(html)
}

fn about(m: &Measured) -> String {
    format!(
        "{}: {:.2} ms, error {:.4}, FLIP {:.4} (95 %: {:.4}), light taken {:+.1} %",
        m.point.label(),
        m.ms,
        m.errors.shadow,
        m.errors.flip_mean,
        m.errors.flip_p95,
        100.0 * m.errors.energy
    )
}

/// The front's points of a subject.
fn table(plot: &FrontPlot<'_>) -> String {
    let mut html = String::from(
        "<table><tr><th>point</th><th>ms</th><th>quartiles</th><th>error</th><th>FLIP</th><th>FLIP 95 %</th>\
         <th>light taken</th><th>settings (others as by default)</th></tr>",
    );
    for &i in plot.front {
        let m = &plot.points[i];
        let names: Vec<&str> = plot.named.iter().filter(|(_, p)| *p == i).map(|(n, _)| n.as_str()).collect();
        let _ = write!(
            html,
            "<tr data-point=\"{i}\"><td>{}</td><td>{:.2}</td><td>{:.2} to {:.2}</td><td>{:.4}</td><td>{:.4}</td><td>{:.4}</td>\
             <td>{:+.1} %</td><td>{}</td></tr>",
            escaped(&names.join(", ")),
            m.ms,
            m.quartiles_ms[0],
            m.quartiles_ms[1],
            m.errors.shadow,
            m.errors.flip_mean,
            m.errors.flip_p95,
            100.0 * m.errors.energy,
            escaped(&m.point.label())
        );
    }
    html + "</table>"
}

/// A picture as a link that holds it.
fn picture(picture: &Rgb8Image) -> Result<String, AssetError> {
    picture_link(&reduced(picture), JPEG_QUALITY)
}

/// Each pixel the mean of a whole number of pixels a side.
fn reduced(picture: &Rgb8Image) -> Rgb8Image {
    let step = picture.width().div_ceil(WIDE).max(1);
    let (width, height) = (picture.width() / step, picture.height() / step);
    let mut out = Image::filled(width.max(1), height.max(1), [0; 3]);
    for y in 0..height {
        for x in 0..width {
            let mut sum = [0u32; 3];
            for k in 0..step * step {
                let p = picture.at(x * step + k % step, y * step + k / step);
                sum.iter_mut().zip(p).for_each(|(s, p)| *s += u32::from(*p));
            }
            *out.at_mut(x, y) = sum.map(|s| (s as usize / (step * step)) as u8);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_fit() {
        let wide = Image::filled(700, 30, [40, 80, 120]);
        let small = reduced(&wide);
        assert_eq!((small.width(), small.height(), *small.at(9, 4)), (233, 10, [40, 80, 120]));
        assert!(picture(&wide).unwrap().starts_with("data:image/jpeg;base64,/9j/"));
    }
}
