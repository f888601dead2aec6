//! Small inputs with large or silent effects, through the tool itself: refused with exit code 2 and a reason, or done within 12 s
//! of processor time and 1000 MiB of address space. Made here by rule; the handed ones as well.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::path::{Path, PathBuf};
use std::process::Command;

/// A folder of this test run, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("halflight-bombs-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn file(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        std::fs::write(&path, content).unwrap();
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Runs the tool under the limits: its exit code and what it said. Killed counts as -1.
fn run(arguments: &[&str]) -> (i32, String) {
    let limited = "ulimit -v 1024000; ulimit -t 12; exec \"$0\" \"$@\"";
    let done = Command::new("sh")
        .args(["-c", limited, env!("CARGO_BIN_EXE_halflight"), "--threads", "2"])
        .args(arguments)
        .output()
        .unwrap();
    (done.status.code().unwrap_or(-1), String::from_utf8_lossy(&done.stderr).into_owned())
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn render(scene: &Path) -> (i32, String) {
    let out = scene.with_extension("png");
    run(&["render", text(scene), "--out", text(&out)])
}

/// A scene that is drawn, with a part of its text replaced and something added.
fn scene(from: &str, to: &str, more: &str) -> String {
    let sound = "[camera]
lens = { width = 32, height = 24, fx = 30.0, fy = 30.0, cx = 16.0, cy = 12.0 }
position = [0.0, -0.6, 0.4]
look_at = [0.0, 0.0, 0.0]
[light]
constant = [0.3, 0.3, 0.3]
[ball]
centre = [-0.2, 0.04, 0.06]
radius_m = 0.06
[[tag]]
id = 0
side_m = 0.1
position = [0.0, 0.0, 0.0]
[[surface]]
shape = \"plane\"
half_extent = 0.5
";
    assert!(sound.contains(from), "{from}");
    format!("{}{more}", sound.replace(from, to))
}

#[test]
fn scenes_that_no_room_holds_are_refused_with_the_range() {
    let folder = Folder::new("scenes");
    let (code, said) = render(&folder.file("sound.toml", scene("", "", "")));
    assert_eq!(code, 0, "{said}");
    let object = |key: &str| format!("[[object]]\nshape = \"box\"\nspheres = 4\n{key}\n");
    for (from, to, more, want) in [
        ("width = 32, height = 24", "width = 16384, height = 16384", "", "camera.lens.width"),
        ("width = 32, height = 24", "width = 8192, height = 8192", "", "at most 33554432 pixels"),
        ("fx = 30.0", "fx = 1e300", "", "camera.lens.fx = 1e300"),
        ("cx = 16.0", "cx = -1e200", "", "camera.lens.cx = -1e200"),
        ("[0.0, -0.6, 0.4]", "[0.0, -1e308, 0.4]", "", "camera.position"),
        ("look_at = [0.0, 0.0, 0.0]", "look_at = [0.0, -0.6, 0.4]", "", "camera.look_at"),
        ("centre = [-0.2", "centre = [1e39", "", "ball.centre"),
        ("radius_m = 0.06", "radius_m = 1e5", "", "ball.radius_m"),
        ("side_m = 0.1", "side_m = 1e3", "", "tag[0].side_m"),
        ("position = [0.0, 0.0, 0.0]", "position = [0.0, 0.0, 4e38]", "", "tag[0].position"),
        ("", "", &object("position = [1e308, 0, 0]"), "within -10000..=10000"),
        ("", "", &object("size = [1e39, 1, 1]"), "object[0].size"),
        ("", "", &object("carry = [[0, 0, 0, 0], [1, 1e39, 0, 0]]"), "object[0].carry"),
    ] {
        let (code, said) = render(&folder.file("bad.toml", scene(from, to, more)));
        assert!(code == 2 && said.contains(want), "{to} {more}: exit {code}: {said}");
    }
}

/// A glTF of one triangle; `more` is added to its JSON.
fn triangle(more: &str, nodes: &str) -> String {
    // Three positions, three indices of 16 bits, two times.
    let data = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAABAAIAAAAAAAAAAACAPw==";
    format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"buffers\":[{{\"byteLength\":52,\"uri\":\"data:;base64,{data}\"}}],
\"bufferViews\":[{{\"buffer\":0,\"byteLength\":36}},{{\"buffer\":0,\"byteOffset\":36,\"byteLength\":6}},{{\"buffer\":0,\"byteOffset\":44,\"byteLength\":8}},{{\"buffer\":0,\"byteLength\":24}}],
\"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\",\"min\":[0,0,0],\"max\":[1,1,0]}},
{{\"bufferView\":1,\"componentType\":5123,\"count\":3,\"type\":\"SCALAR\"}},
{{\"bufferView\":2,\"componentType\":5126,\"count\":2,\"type\":\"SCALAR\"}},
{{\"bufferView\":3,\"componentType\":5126,\"count\":2,\"type\":\"VEC3\"}}],
\"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}},\"indices\":1}}]}}],
\"nodes\":[{nodes}],\"scenes\":[{{\"nodes\":[0]}}],\"scene\":0{more}}}"
    )
}

fn with_model(folder: &Folder, model: &str, keys: &str) -> (i32, String) {
    folder.file("model.gltf", model);
    let object = format!("[[object]]\nfile = \"model.gltf\"\nheight_m = 0.1\n{keys}\n");
    render(&folder.file("scene.toml", scene("", "", &object)))
}

/// Linear in the number of names and of joints.
#[test]
fn many_equal_names_and_many_nodes_of_one_skin_load() {
    let folder = Folder::new("names");
    let (code, said) = with_model(&folder, &triangle("", "{\"mesh\":0}"), "");
    assert_eq!(code, 0, "{said}");
    let clip = "{\"name\":\"Walk\",\"channels\":[{\"sampler\":0,\"target\":{\"node\":0,\"path\":\"translation\"}}],\"samplers\":[{\"input\":2,\"output\":3}]}";
    let clips = format!(",\"animations\":[{}]", vec![clip; 20_000].join(","));
    let model = triangle(&clips, "{\"mesh\":0}");
    let (code, said) = with_model(&folder, &model, "animation = \"Walk 20000\"");
    assert_eq!(code, 0, "{said}");
    let (code, said) = with_model(&folder, &model, "animation = \"Run\"");
    assert!(code == 2 && said.contains("and 19970 more"), "{said}");
    // 2000 materials of one name, each in use.
    let primitive =
        |k: usize| format!("{{\"attributes\":{{\"POSITION\":0}},\"indices\":1,\"material\":{k}}}");
    let primitives: Vec<String> = (0..2000).map(primitive).collect();
    let model = triangle(
        &format!(",\"materials\":[{}]", vec!["{\"name\":\"Paint\"}"; 2000].join(",")),
        "{\"mesh\":0}",
    )
    .replace(&primitive(0).replace(",\"material\":0", ""), &primitives.join(","));
    let (code, said) = with_model(&folder, &model, "spheres = 4");
    assert_eq!(code, 0, "{said}");
}

/// 1000 meshes that share one skin of 1000 joints: its matrices are made once.
#[test]
fn many_meshes_of_one_skin_load() {
    const MANY: usize = 1000;
    let folder = Folder::new("skins");
    let list = |from: usize| (from..from + MANY).map(|k| k.to_string()).collect::<Vec<_>>().join(",");
    // A root, the joints, the meshes.
    let mut nodes = vec![format!("{{\"children\":[{},{}]}}", list(1), list(1 + MANY))];
    nodes.extend((0..MANY).map(|k| format!("{{\"name\":\"joint\",\"translation\":[{k},0,0]}}")));
    nodes.extend((0..MANY).map(|_| "{\"mesh\":0,\"skin\":0}".to_owned()));
    let skins = format!(",\"skins\":[{{\"joints\":[{}]}}]", list(1));
    // The first position's zeros stand for weights, too: all hangs on the skin's first joint.
    let model = triangle(&skins, &nodes.join(","))
        .replace("\"attributes\":{\"POSITION\":0}", "\"attributes\":{\"POSITION\":0,\"JOINTS_0\":4,\"WEIGHTS_0\":5}")
        .replace("\"count\":2,\"type\":\"VEC3\"}]", "\"count\":2,\"type\":\"VEC3\"},{\"bufferView\":0,\"componentType\":5121,\"count\":3,\"type\":\"VEC4\"},{\"bufferView\":0,\"componentType\":5121,\"normalized\":true,\"count\":3,\"type\":\"VEC4\"}]");
    for keys in ["spheres = 4", "spheres = 4\nheight_m = 0.2"] {
        folder.file("model.gltf", &model);
        let object = format!("[[object]]\nfile = \"model.gltf\"\n{keys}\n");
        let (code, said) = render(&folder.file("scene.toml", scene("", "", &object)));
        assert_eq!(code, 0, "{said}");
    }
}

#[test]
fn accessors_without_bytes_are_refused_where_they_are_large() {
    let folder = Folder::new("accessors");
    let model = triangle("", "{\"mesh\":0}").replace(
        "\"bufferView\":0,\"componentType\":5126,\"count\":3",
        "\"componentType\":5126,\"count\":16000000",
    );
    let (code, said) = with_model(&folder, &model, "");
    assert!(code == 2 && said.contains("accessors[0]"), "exit {code}: {said}");
}

#[test]
fn uris_do_not_leave_the_models_folder() {
    let folder = Folder::new("uris");
    for uri in [
        "../../../../../../../../etc/passwd",
        "/etc/passwd",
        "%2e%2e/%2e%2e/etc/passwd",
        "file:///etc/passwd",
    ] {
        let model = triangle("", "{\"mesh\":0}");
        let start = model.find("data:").unwrap();
        let end = start + model[start..].find('"').unwrap();
        let model = format!("{}{uri}{}", &model[..start], &model[end..]);
        let (code, said) = with_model(&folder, &model, "");
        assert!(
            code == 2 && said.contains("buffers[0].uri") && said.contains("model's folder"),
            "{uri}: {said}"
        );
    }
}

/// Aliases behind quotes, comments, block texts and keys.
#[test]
fn aliases_are_refused_wherever_they_stand() {
    use halflight::assets::calibration::parse;
    let camera = "K: [500.0, 0.0, 32.0, 0.0, 500.0, 24.0, 0.0, 0.0, 1.0]\n";
    let read = |text: &str| {
        parse(text.as_bytes(), None, Path::new("cam.yml")).map(|_| ()).map_err(|e| e.to_string())
    };
    assert_eq!(read(camera), Ok(()));
    for harmless in [
        "note: 'an & and a * in quotes'\n",
        "note: \"&a *a\"\n",
        "# &a *a\n",
        "note: a&b*c\n",
        "note: |\n  &a\n  *a\n",
        "note: \"\n  # &a\n  *a\"\n",
    ] {
        assert_eq!(read(&format!("{camera}{harmless}")), Ok(()), "{harmless}");
    }
    for bomb in [
        "x: &a [1]\n",
        "x: &a [1]\ny: *a\n",
        "x:\n  [\"\n  #\", &a [1,1], \"\n  #\", [*a,*a]]\n",
        "x: '\n  #' \ny: &b [1]\n",
        "&k x: 1\n",
        "x: &t text\n",
        "x: {y: &m {z: 1}}\n",
    ] {
        let error = read(&format!("{camera}{bomb}")).unwrap_err();
        assert!(error.contains("an anchor or alias: must be written out"), "{bomb}: {error}");
    }
    // An area as well as a side.
    for size in ["image_width: 65535\nimage_height: 1\n", "image_width: 16384\nimage_height: 16384\n"] {
        assert!(read(&format!("{camera}{size}")).unwrap_err().contains("image_width"), "{size}");
    }
}

#[test]
fn the_handed_bombs_are_refused_or_load() {
    let Some(shared) = support::shared("bombs") else { return };
    let bombs = shared.join("bombs");
    if !bombs.is_dir() {
        return support::skipped("bombs: none in the shared data");
    }
    let folder = Folder::new("handed");
    for (name, want) in [("lens16384.toml", "camera.lens"), ("position1e308.toml", "object[0].position")] {
        let out = folder.0.join("out.png");
        let (code, said) = run(&["render", text(&bombs.join(name)), "--out", text(&out)]);
        assert!(code == 2 && said.contains(want), "{name}: exit {code}: {said}");
    }
    for (name, want) in
        [("m_cal_wmax.mcap", "4294967295 x 4294967295"), ("m_pngbomb22k.mcap", "22000 x 22000")]
    {
        let (code, said) = run(&["replay", text(&bombs.join(name))]);
        assert!(code == 2 && said.contains(want), "{name}: exit {code}: {said}");
    }
    let object = |model: &str, keys: &str| {
        let file = bombs.join(model);
        let object = format!("[[object]]\nfile = \"{}\"\nheight_m = 0.1\n{keys}\n", text(&file));
        render(&folder.file("scene.toml", scene("", "", &object)))
    };
    let (code, said) = object("uri_passwd.gltf", "");
    assert!(code == 2 && said.contains("buffers[0].uri"), "exit {code}: {said}");
    let (code, said) = object("anim3000.glb", "animation = \"none of them\"");
    assert!(code == 2 && said.contains("object[0].animation"), "exit {code}: {said}");
    let (code, said) = object("anim3000.glb", "");
    assert_eq!(code, 0, "{said}");
    let yaml = std::fs::read(bombs.join("y_bomb9.yaml")).unwrap();
    let error = halflight::assets::calibration::parse(&yaml, None, Path::new("y")).unwrap_err().to_string();
    assert!(error.contains("anchor or alias"), "{error}");
}
