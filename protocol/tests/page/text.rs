//! Reads the page: headings, tables, listings, bytes.

/// The page.
pub const PAGE: &str = include_str!("../../README.md");

/// Every heading, with what stands under it up to the next one. Lines of listings are no headings.
pub fn sections() -> Vec<(&'static str, Vec<&'static str>)> {
    let mut sections = vec![("", Vec::new())];
    let mut in_listing = false;
    for line in PAGE.lines() {
        in_listing ^= line.starts_with("```");
        let hashes = line.trim_start_matches('#');
        match hashes.strip_prefix(' ') {
            Some(title) if hashes.len() < line.len() && !in_listing => {
                sections.push((title, Vec::new()));
            }
            _ => sections.last_mut().unwrap().1.push(line),
        }
    }
    sections
}

/// What stands under the one heading of this title.
pub fn under(title: &str) -> Vec<&'static str> {
    let mut found = sections().into_iter().filter(|section| section.0 == title);
    let (_, lines) = found.next().unwrap_or_else(|| panic!("no heading {title:?}"));
    assert!(found.next().is_none(), "two headings {title:?}");
    lines
}

fn cells(row: &str) -> Vec<&str> {
    row.trim_matches('|').split('|').map(str::trim).collect()
}

/// The rows of the table under this heading whose first column is called so.
pub fn table(title: &str, first_column: &str) -> Vec<Vec<&'static str>> {
    let lines = under(title);
    let is_head = |line: &&str| line.starts_with('|') && cells(line)[0] == first_column;
    let head = lines.iter().position(is_head);
    let head = head.unwrap_or_else(|| panic!("no table {first_column:?} under {title:?}"));
    let columns = cells(lines[head]).len();
    assert!(lines[head + 1].starts_with("|---"), "under {title:?}");
    let rows = lines[head + 2..].iter().take_while(|line| line.starts_with('|'));
    let rows: Vec<_> = rows.map(|row| cells(row)).collect();
    assert!(!rows.is_empty() && rows.iter().all(|row| row.len() == columns), "under {title:?}");
    rows
}

/// The listings of a language under this heading.
pub fn listings(title: &str, language: &str) -> Vec<String> {
    let text = under(title).join("\n");
    let fence = format!("```{language}\n");
    let rest = text.split(&fence).skip(1);
    rest.map(|rest| rest.split("```").next().unwrap().to_owned()).collect()
}

/// The bytes that a cell shows: `5E 02`, or none.
pub fn bytes(cell: &str) -> Vec<u8> {
    if cell == "none" {
        return Vec::new();
    }
    let inside = cell.strip_prefix('`').and_then(|cell| cell.split_once('`')).expect("bytes").0;
    inside.split(' ').map(|byte| u8::from_str_radix(byte, 16).expect(cell)).collect()
}

/// "NoSuchSetting" or "no_such_setting" as the page has it: "no such setting".
pub fn words(name: &str) -> String {
    let mut words = String::new();
    for c in name.chars() {
        if c == '_' || (c.is_uppercase() && !words.is_empty()) {
            words.push(' ');
        }
        words.extend(c.to_lowercase().filter(|c| *c != '_'));
    }
    words
}

#[test]
fn every_link_within_the_page_leads_to_a_heading() {
    let anchor = |title: &str| -> String {
        let kept = title.to_lowercase().replace(' ', "-");
        kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, '-' | '_')).collect()
    };
    let anchors: Vec<_> = sections().iter().map(|section| anchor(section.0)).collect();
    let mut links = 0;
    for rest in PAGE.split("](#").skip(1) {
        let link = rest.split(')').next().unwrap();
        assert_eq!(anchors.iter().filter(|anchor| *anchor == link).count(), 1, "#{link}");
        links += 1;
    }
    assert!(links > 30);
    // Modules link here too.
    for link in [
        "the-extension",
        "requests",
        "what-the-manual-proves-and-what-we-chose",
        "arcos-and-the-pioneer-arm",
        "what-its-documents-prove-and-what-we-chose",
        "the-extension-in-arcos",
        "the-cm-5",
        "what-its-page-proves-and-what-we-chose",
    ] {
        assert!(anchors.iter().any(|anchor| anchor == link), "#{link}");
    }
}
