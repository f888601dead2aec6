//! `halflight stress` as people call it.

use std::process::{Command, Output};

fn stress(arguments: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_halflight");
    Command::new(program).arg("stress").args(arguments).output().expect("the program starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn json_has_every_number_with_its_bound() {
    let output = stress(&["--json", "--only", "Near light"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let cases = report["cases"].as_array().expect("a list");
    assert!(cases.len() >= 9, "{report}");
    assert_eq!((&report["broken"], &report["engines"][0]["name"]), (&0.into(), &"CPU".into()));
    for case in cases {
        assert_eq!(case["group"], "Near light");
        assert_eq!(case["textbook"]["holds"], false, "{case}");
        let ours = &case["ours"][0];
        assert_eq!(ours["holds"], true, "{case}");
        let number = ours["number"].as_f64().expect("a number");
        let bound = |which: &str| case["bound"][which].as_f64().expect("a number");
        assert!((bound("least")..=bound("most")).contains(&number), "{case}");
    }
}

#[test]
fn pages_are_written_and_stand_alone() {
    let folder = std::env::temp_dir().join(format!("halflight-stress-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let (html, markdown) = (folder.join("page.html"), folder.join("page.md"));
    let paths = [html.to_str().expect("UTF-8"), markdown.to_str().expect("UTF-8")];
    let output = stress(&["--only", "Poses", "--html", paths[0], "--markdown", paths[1]]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    assert!(table.contains("two pictures a microsecond apart") && table.contains("ours keep all"), "{table}");
    let page = std::fs::read_to_string(&html).expect("the page");
    assert!(page.starts_with("<!doctype html>") && page.contains("two pictures a microsecond apart"));
    assert!(
        !page.contains("src=") && !page.contains("http") && !page.contains("@import"),
        "it fetches something"
    );
    assert_eq!(page.matches("<table>").count(), page.matches("</table>").count());
    assert!(std::fs::read_to_string(&markdown).expect("the page").contains("## Poses and time"));
    std::fs::remove_dir_all(&folder).expect("removed");
}

#[test]
fn bad_input_is_told() {
    let output = stress(&["--only", "no such thing"]);
    assert_eq!(output.status.code(), Some(2));
    let error = text(&output.stderr);
    assert!(error.contains("no such thing") && error.contains("Near light"), "{error}");
    let output = stress(&["--only", "Poses", "--html", "no/such/folder/page.html"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("no/such/folder/page.html"));
    let output = stress(&["--all", "--engine", "cpu"]);
    assert_eq!(output.status.code(), Some(2), "both");
}
