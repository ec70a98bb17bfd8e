use super::*;

#[derive(Serialize)]
struct Mine {
    x: &'static str,
    y: Option<f64>,
}

impl Row for Mine {
    const HEADINGS: &'static [&'static str] = &["x", "y"];

    fn cells(&self) -> Vec<String> {
        vec![self.x.to_owned(), number(self.y, 1)]
    }
}

#[test]
fn three_forms() {
    let rows = [Mine { x: "p|q", y: Some(1.25) }, Mine { x: "a,\"b", y: None }];
    let table = Table::of("T", "a < b", &rows);
    assert!(table.to_markdown().contains("| p\\|q | 1.2 |"), "{}", table.to_markdown());
    assert!(table.to_html().contains("a &lt; b") && table.to_html().contains("<td>p|q</td>"));
    let mut csv = Vec::new();
    write_csv(&mut csv, &rows).expect("written");
    assert_eq!(String::from_utf8_lossy(&csv), "x,y\np|q,1.25\n\"a,\"\"b\",\n");
}
