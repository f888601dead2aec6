//! The one table of keys of scene files, and the manual that is made of it (`docs/scenes.md`). Tests hold the table to what the
//! reader asks for.

/// One key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneKey {
    /// Its table: `camera`, `camera.lens`, `object`.
    pub section: &'static str,
    /// Its name in the table.
    pub name: &'static str,
    /// Unit, or empty.
    pub unit: &'static str,
    /// What it may hold.
    pub range: &'static str,
    /// What holds where it is left out.
    pub default: &'static str,
    /// What it does.
    pub effect: &'static str,
}

/// One table of the file: its name, how it is written, and what it is for.
pub const SECTIONS: [(&str, &str, &str); 9] = [
    (
        "camera",
        "[camera]",
        "The camera of a still. A recording brings its own; its lens is then replaced by this one.",
    ),
    ("camera.lens", "[camera] lens = { .. }", "The lens in numbers, in pixels: pixel (0, 0) covers 0 to 1."),
    (
        "light",
        "[light]",
        "Where the light of a still comes from: one of `measure`, `file`, `constant` and `to_light` (the last two together or alone).",
    ),
    ("room", "[room]", "Known geometry of the real place: near light and its shadows."),
    ("ball", "[ball]", "The mirror ball that light is read off."),
    ("tag", "[[tag]]", "AprilTags (36h11) whose places are known; one table for each."),
    (
        "surface",
        "[[surface]]",
        "Real surfaces: they receive virtual shadows and hide what lies behind them; one table for each.",
    ),
    ("object", "[[object]]", "Virtual objects; one table for each."),
    ("object.material", "[[object]] material = { .. }", "What an object is made of."),
];

/// Where a picture of the environment lies, the same in `[light]` and `[room]`.
const LAYOUT: &str = "\"equirect\", \"angular\" or \"cube\"";
const LAYOUT_EFFECT: &str = "How the environment picture covers the sphere.";
const RIGID: &str = "four rows of four numbers, a rigid transform";

macro_rules! rows {
    ($($section:literal $name:literal $unit:literal $range:expr, $default:literal, $effect:expr;)+) => {
        &[$(SceneKey {
            section: $section, name: $name, unit: $unit, range: $range, default: $default, effect: $effect,
        }),+]
    };
}

/// Every key, by its table.
pub const KEYS: &[SceneKey] = rows! {
    "camera" "calibration" "" "a text", "none: `lens` must be given", "Calibration file: OpenCV or ROS YAML; FILE#NAME picks one of several cameras.";
    "camera" "lens" "" "a table", "none: `calibration` must be given", "The lens in numbers.";
    "camera" "world_from_camera" "m" RIGID, "`position` and `look_at`", "Pose of the camera: x right, y down, z forward in its own frame.";
    "camera" "position" "m" "three finite numbers", "the origin", "Where the camera is.";
    "camera" "look_at" "m" "three finite numbers", "none: needed with `position`", "What the middle of the picture shows.";
    "camera" "up" "" "three finite numbers", "[0, 0, 1]", "What is up in the picture, with `look_at`.";
    "camera" "pictures" "" "a list of file names", "none: a gray place is drawn", "The place as it is: the background. Several are one bracket and are merged.";
    "camera" "exposures_s" "s" "a list of numbers above 0, one for each of the pictures", "1 for one picture", "Exposure time of each picture (times gain where gains differ).";
    "camera" "response" "" "\"srgb\", \"solve\" or a file name", "\"srgb\"", "How exposure becomes 8 bits: sRGB, from the pictures, or a JSON file that `halflight hdr --save-response` wrote.";

    "camera.lens" "width" "px" "an integer within 1..=16384", "none: must be given", "Columns of the picture.";
    "camera.lens" "height" "px" "an integer within 1..=16384", "none: must be given", "Rows of the picture.";
    "camera.lens" "fx" "px" "a number above 0", "none: must be given", "Focal length along x.";
    "camera.lens" "fy" "px" "a number above 0", "none: must be given", "Focal length along y.";
    "camera.lens" "cx" "px" "a finite number", "none: must be given", "Principal point, x.";
    "camera.lens" "cy" "px" "a finite number", "none: must be given", "Principal point, y.";
    "camera.lens" "distortion" "" "4 to 8 numbers: k1, k2, p1, p2, k3, k4, k5, k6", "none", "Radial and tangential distortion, as OpenCV has it.";
    "camera.lens" "fisheye" "" "4 numbers: k1, k2, k3, k4", "none", "Equidistant distortion, as OpenCV's fisheye model has it; wins over `distortion`.";

    "light" "measure" "" "\"ball\"", "none", "The light is read off the ball in `pictures`.";
    "light" "pictures" "" "a list of file names", "none: needed with `measure`", "Pictures of the ball, by the same camera.";
    "light" "exposures_s" "s" "a list of numbers above 0, one for each of the pictures", "1 for one picture", "Exposure time of each picture.";
    "light" "response" "" "\"srgb\", \"solve\" or a file name", "\"srgb\"", "As `camera.response`; that of the bracket with more pictures serves both.";
    "light" "file" "" "a text", "none", "An environment picture: Radiance, OpenEXR, PNG or JPEG.";
    "light" "layout" "" LAYOUT, "\"equirect\"", LAYOUT_EFFECT;
    "light" "up" "" "\"z\" or \"y\"", "\"z\"", "Which axis of the environment picture points up.";
    "light" "rotation_deg" "degrees" "a number within -360..=360", "0", "Turns the environment picture about the world's z axis, counter-clockwise seen from above.";
    "light" "constant" "radiance" "three numbers within 0..=1000000", "[0, 0, 0]", "Uniform light, r, g, b.";
    "light" "to_light" "" "a vector of three numbers that is not zero", "none", "Direction towards a directional light.";
    "light" "irradiance_rgb" "irradiance" "three numbers within 0..=1000000", "none: needed with `to_light`", "Irradiance of the directional light on a surface that faces it.";
    "light" "below" "" "\"given\", \"dark\" or \"surface\"", "\"given\"", "Light from below the horizon: as given, none, or what the surface z = 0 sends up. Not with `measure`: `ball.on_surface` says it.";
    "light" "surface_albedo_rgb" "" "three numbers within 0..=1", "[0.5, 0.5, 0.5]", "Albedo of that surface, with `below = \"surface\"`.";

    "room" "file" "" "a text", "none: must be given", "The room: glTF (emissive parts shine), or a reference case.";
    "room" "light" "" "\"given\" or \"probe\"", "\"given\"", "Where its radiance comes from: what its surfaces emit, or a probe.";
    "room" "probe" "" "a text", "none: needed with `light = \"probe\"`", "An environment picture that was taken in the room.";
    "room" "probe_position" "m" "three finite numbers", "none: needed with `light = \"probe\"`", "Where it was taken.";
    "room" "layout" "" LAYOUT, "\"equirect\"", LAYOUT_EFFECT;
    "room" "up" "" "\"z\" or \"y\"", "\"z\"", "Which axis of the probe's picture points up.";
    "room" "rotation_deg" "degrees" "a number within -360..=360", "0", "Turns the probe's picture about the world's z axis.";
    "room" "sun" "" "true or false", "true", "Small strong lights that the probe sees become suns that shine in.";
    "room" "probe_rows" "rows" "a whole number within 8..=16384", "as it is", "Rows that the probe's picture is reduced to, about.";
    "room" "patch_m" "m" "a number within 0.005..=10", "1500 patches", "Mean size of a patch.";
    "room" "power_share" "" "a number above 0, at most 1", "0.7", "Share of the power of all patches that the sources of shadows have.";
    "room" "neglected_share" "" "a number within 0..=0.5", "0.005", "Share of the light at each corner that may be neglected.";
    "room" "rays" "rays" "1, 4, 9, 16, 25, 36, 49 or 64", "1", "Rays from each corner to each source.";

    "ball" "centre" "m" "three finite numbers", "none: must be given", "Its middle.";
    "ball" "radius_m" "m" "a number within 0.001..=10", "none: must be given", "Its radius.";
    "ball" "reflectance_rgb" "" "three numbers above 0, at most 1", "[1, 1, 1]", "Share of the light that it reflects.";
    "ball" "on_surface" "" "true or false", "true", "It stands on the surface: what it sees below the horizon is replaced by the unshadowed surface.";
    "ball" "surface_radius_m" "m" "a number within 0.001..=100", "12 radii", "The surface is flat and of one kind this far around it.";

    "tag" "id" "" "an integer within 0..=586", "none: must be given", "Its number.";
    "tag" "side_m" "m" "a number within 0.001..=10", "none: must be given", "Side of its black square.";
    "tag" "position" "m" "three finite numbers", "the origin", "Its middle. It lies flat; its upright picture's upper edge points to +y.";
    "tag" "yaw_deg" "degrees" "a number within -360..=360", "0", "Turns it about z, counter-clockwise seen from above.";
    "tag" "world_from_tag" "m" RIGID, "`position` and `yaw_deg`", "Its pose, where it does not lie flat: x right, y down in its upright picture, z into it.";

    "surface" "name" "" "a text", "\"surface 0\" and so on", "How messages call it.";
    "surface" "shape" "" "\"plane\", \"box\", \"sphere\", \"cylinder\" or \"quad\"", "none: `file` must be given", "Its shape. `position` is the middle of all but the cylinder.";
    "surface" "file" "" "a text", "none", "Its shape as OBJ or glTF.";
    "surface" "receives_shadow" "" "true or false", "true", "Virtual shadows fall on it; false: it only hides.";
    "surface" "position" "m" "three finite numbers", "the origin", "Its own origin in the world.";
    "surface" "yaw_deg" "degrees" "a number within -360..=360", "0", "Turns it about z.";
    "surface" "half_extent" "m" "a number within 0.0001..=1000", "1", "Half a side of the plane z = 0.";
    "surface" "corners" "m" "four points of three numbers, counter-clockwise from the front", "none: needed with \"quad\"", "Corners of a quad.";
    "surface" "size" "m" "three numbers above 0", "[0.1, 0.1, 0.1]", "Sides of a box.";
    "surface" "radius_m" "m" "a number within 0.0001..=1000", "0.05", "Radius of a sphere or cylinder.";
    "surface" "height_m" "m" "a number within 0.0001..=1000", "0.1", "Height of a cylinder.";

    "object" "name" "" "a text", "\"object 0\" and so on", "How messages call it.";
    "object" "shape" "" "\"pawn\", \"pawn_with_ring\", \"vase\", \"sphere\", \"box\", \"cylinder\", \"capsule\", \"torus\" or \"torus_knot\"", "none: `file` must be given", "Its shape.";
    "object" "file" "" "a text", "none", "Its shape, materials and animations as glTF.";
    "object" "material" "" "a table", "the file's, or matt with albedo 0.7", "What it is made of.";
    "object" "position" "m" "three finite numbers", "the origin", "Where its lowest point stands (`origin`).";
    "object" "yaw_deg" "degrees" "a number within -360..=360", "0", "Turns it about z, counter-clockwise seen from above.";
    "object" "origin" "" "\"lowest\" or \"file\"", "\"lowest\"", "What stands at `position`: its middle above its lowest point, or the file's own origin.";
    "object" "scale" "" "a number within 0.0001..=10000", "1", "Makes it larger or smaller; `height_m` of a file wins.";
    "object" "height_m" "m" "a number within 0.0001..=1000", "0.12 (vase 0.15, cylinder 0.1); of a file: as it is", "Its height.";
    "object" "size" "m" "three numbers above 0", "[0.1, 0.1, 0.1]", "Sides of a box.";
    "object" "radius_m" "m" "a number within 0.0001..=1000", "0.05 (capsule 0.03, torus 0.04, knot 0.03)", "Radius of a sphere, cylinder, capsule, torus or knot.";
    "object" "wire_radius_m" "m" "a number within 0.0001..=1000", "0.012 (knot 0.01)", "Radius of the wire of a torus or knot.";
    "object" "spheres" "spheres" "a whole number within 4..=64", "16", "Spheres that stand for it where it blocks soft light.";
    "object" "animation" "" "the name of one of the file's animations", "none: it stands as its file's nodes say", "What it does, again and again.";
    "object" "animation_speed" "" "a number within -100..=100", "1", "Seconds of the animation in a second.";
    "object" "animation_start_s" "s" "a number within -1000000..=1000000", "0", "Where in the animation it begins.";
    "object" "path" "m" "at least 3 corners of two numbers, 0.001 m or more apart", "none", "A closed way on which it walks round and round; corners are rounded, and it faces its way (plus `yaw_deg`).";
    "object" "path_speed_m_s" "m/s" "a number within 0..=100", "none: needed with `path`", "How fast it walks.";
    "object" "carry" "s, m" "at least 2 rows of four numbers: time_s, x, y, z; times from 0 on, rising", "none", "Places that a hand carries it through, smooth between them: those of its lowest point.";

    "object.material" "kind" "" "\"lambert\", \"phong\" or \"mirror\"", "none: must be given", "Matt, glossy, or a mirror.";
    "object.material" "albedo_rgb" "" "three numbers within 0..=1", "[0.7, 0.7, 0.7] (phong 0.5)", "Share of the light that it scatters.";
    "object.material" "specular_rgb" "" "three numbers within 0..=1", "[0.2, 0.2, 0.2]", "Share of the light that its gloss reflects (phong).";
    "object.material" "exponent" "" "a number within 0..=100000", "20", "How sharp its gloss is (phong).";
    "object.material" "reflectance_rgb" "" "three numbers within 0..=1", "[1, 1, 1]", "Share of the light that a mirror reflects.";
};

/// The manual, as Markdown.
pub fn manual() -> String {
    let mut out = String::from(
        "# Scene files\n\n\
         A scene file (TOML) says what stands in a place: virtual objects, real surfaces, tags, the mirror ball, a known room;\n\
         for stills also the camera and the light. World frame: right-handed, z up, metres; the surface that things stand on is\n\
         z = 0. Paths are relative to the scene file. `halflight check SCENE` prints every mistake of a file at once, each with\n\
         its line and column. `tests/scenes/` has complete files: `still.toml` is one with a camera.\n\n\
         This page is made from the table in `src/assets/scene/keys.rs`; a test keeps both equal, and the table equal to what\n\
         the reader knows.\n",
    );
    for (section, written, what) in SECTIONS {
        out += &format!(
            "\n## `{written}`\n\n{what}\n\n| key | unit | must be | default | effect |\n|---|---|---|---|---|\n"
        );
        for key in KEYS.iter().filter(|key| key.section == section) {
            let SceneKey { name, unit, range, default, effect, .. } = key;
            out += &format!("| `{name}` | {unit} | {range} | {default} | {effect} |\n");
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::path::Path;

    /// What the reader says it knows, of a file with an unknown key in one table.
    fn asked(text: &str) -> BTreeSet<String> {
        let told = super::super::parse(Path::new("s.toml"), text).unwrap_err().to_string();
        let line = told.lines().find(|line| line.contains("zzzzzzzzzzzz")).unwrap();
        line.split_once("one of ").unwrap().1.split(", ").map(str::to_owned).collect()
    }

    #[test]
    fn the_table_has_what_the_reader_asks_for_and_nothing_else() {
        const WRONG: &str = "zzzzzzzzzzzz = 1";
        let mut found: Vec<(&str, BTreeSet<String>)> = vec![
            ("camera", asked(&format!("[camera]\n{WRONG}"))),
            ("camera.lens", asked(&format!("[camera.lens]\n{WRONG}"))),
            ("light", asked(&format!("[light]\nmeasure = \"ball\"\n{WRONG}"))),
            ("room", asked(&format!("[room]\n{WRONG}"))),
            ("ball", asked(&format!("[ball]\n{WRONG}"))),
            ("tag", asked(&format!("[[tag]]\n{WRONG}"))),
        ];
        let union = |table: &str, shapes: &[&str], more: &str| -> BTreeSet<String> {
            let with = |head: &str| asked(&format!("[[{table}]]\n{head}\n{WRONG}"));
            let of_shapes = shapes.iter().flat_map(|shape| with(&format!("shape = \"{shape}\"")));
            of_shapes.chain(with(more)).collect()
        };
        found.push((
            "surface",
            union("surface", &["plane", "box", "sphere", "cylinder", "quad"], "file = \"no.obj\""),
        ));
        let shapes =
            ["pawn", "pawn_with_ring", "vase", "sphere", "box", "cylinder", "capsule", "torus", "torus_knot"];
        found.push(("object", union("object", &shapes, "file = \"no.glb\"")));
        let material = ["lambert", "phong", "mirror"].iter().flat_map(|kind| {
            asked(&format!("[[object]]\nshape = \"box\"\n[object.material]\nkind = \"{kind}\"\n{WRONG}"))
        });
        found.push(("object.material", material.collect()));
        for (section, asked) in found {
            let table: BTreeSet<String> =
                KEYS.iter().filter(|k| k.section == section).map(|k| k.name.to_owned()).collect();
            assert_eq!(table, asked, "[{section}]");
        }
    }

    #[test]
    fn ranges_are_those_that_messages_state() {
        // A number that no key allows is refused with the range that the table states.
        for key in KEYS.iter().filter(|k| k.range.contains("within") && !k.section.contains('.')) {
            let array = if ["tag", "surface", "object"].contains(&key.section) { 2 } else { 1 };
            let (open, close) = ("[".repeat(array), "]".repeat(array));
            let shape = match (key.section, key.name) {
                ("surface", "half_extent") => "shape = \"plane\"",
                ("surface" | "object", "radius_m" | "height_m") => "shape = \"cylinder\"",
                ("object", "wire_radius_m") => "shape = \"torus\"",
                _ => "",
            };
            let text = format!("{open}{}{close}\n{shape}\n{} = -99999999", key.section, key.name);
            let told = super::super::parse(Path::new("s.toml"), &text).unwrap_err().to_string();
            let line = told.lines().find(|line| line.contains("= -99999999")).unwrap_or(&told);
            assert!(line.contains(key.range), "{}.{}: {line}", key.section, key.name);
        }
    }

    #[test]
    fn every_section_has_keys() {
        assert!(KEYS.iter().all(|key| SECTIONS.iter().any(|(section, ..)| *section == key.section)));
        assert!(manual().contains("| `centre` | m | three finite numbers |"));
    }
}
