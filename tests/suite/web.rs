//! The pages of `microsig view` in a real browser.

/// Not with the other tests: it installs Chromium and Node.js if they are missing. `.ci/run` asks for it.
#[test]
#[ignore = "installs a browser"]
fn pages_work_in_a_browser() {
    suite::web::run(suite::microsig::binary(), None).unwrap();
}
