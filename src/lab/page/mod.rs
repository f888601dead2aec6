//! What pages and plots for people are written with: text made safe for HTML, and SVG.

pub mod html;
pub mod svg;
