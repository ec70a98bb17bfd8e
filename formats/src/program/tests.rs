use super::*;
use clap::Parser;

#[derive(Parser)]
struct Cli {
    #[command(flatten)]
    common: CommonArgs,
    #[arg(long, value_parser = length)]
    distance: Option<f64>,
    #[arg(long, value_parser = share)]
    below: Option<f64>,
    #[arg(long, num_args = 1..)]
    offset: Vec<f64>,
    #[arg(long, num_args = 1..)]
    place: Vec<String>,
}

fn parse(words: &[&str]) -> Result<CommonArgs, String> {
    let cli = parse_from::<Cli>(std::iter::once("program").chain(words.iter().copied()).map(OsString::from));
    cli.map(|cli| cli.common).map_err(|e| e.to_string())
}

#[test]
fn numbers_out_of_range_are_values_and_their_check_says_so() {
    for (words, expected) in [
        (["--distance", "-1"], "length above 0"),
        (["--distance", "-0.5"], "length above 0"),
        (["--distance", "nan"], "length above 0"),
        (["--below", "2"], "share from 0 to 1"),
        (["--below", "-0.5"], "share from 0 to 1"),
        (["--seed", "-1"], "whole number"),
    ] {
        let message = parse(&words).expect_err(words[1]);
        assert!(message.contains(words[0]) && message.contains(expected), "{message}");
    }
    assert!(parse(&["--distance", "0.4", "--below", "0.01"]).is_ok());
    assert!(parse(&["-1"]).is_err(), "a number without its flag");
}

#[test]
fn a_number_below_zero_is_a_value_however_it_is_written() {
    let words = "program --offset -1e-3 -.5 -2E3 -4. --place -1,0,2 -1e-3,0,1 -0.6..1 --seed 7 -v";
    let cli = parse_from::<Cli>(words.split(' ').map(OsString::from)).expect("values");
    assert_eq!(cli.offset, [-1e-3, -0.5, -2e3, -4.0]);
    let place: Vec<&str> = cli.place.iter().map(|text| text.trim()).collect();
    assert_eq!(place, ["-1,0,2", "-1e-3,0,1", "-0.6..1"]);
    assert_eq!((cli.common.seed, cli.common.verbose), (Some(7), 1), "flags stay flags");
    for words in [["--distance", "-1e-3"], ["--distance", "-inf"], ["--distance", "-.5"]] {
        assert!(parse(&words).expect_err(words[1]).contains("length above 0"), "{words:?}");
    }
}

#[test]
fn every_cause_is_said_once() {
    let missing = std::fs::read("no/such/file").expect_err("no such file");
    let config = ConfigError::Io { path: "a.toml".into(), cause: missing };
    let said = "cannot read configuration \"a.toml\": No such file or directory (os error 2)";
    assert_eq!(with_causes(&config), said);
    #[derive(Debug, thiserror::Error)]
    #[error("--config")]
    struct Context(#[source] ConfigError);
    assert_eq!(with_causes(&Context(config)), format!("--config: {said}"));
}

#[test]
fn seeds_are_whole_numbers_that_settings_can_keep() {
    #[derive(Default, Serialize, serde::Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Settings {
        seed: u64,
    }
    let largest = i64::MAX.to_string();
    let args = parse(&["--seed", &largest]).expect("fits");
    assert_eq!(args.settings::<Settings>([]).expect("settings").seed, i64::MAX.cast_unsigned());
    for bad in ["9223372036854775808", "-1", "1.5", "x"] {
        let message = parse(&[&format!("--seed={bad}")]).expect_err(bad);
        assert!(message.contains("--seed") && message.contains("9223372036854775807"), "{message}");
    }
    let args = parse(&["--set", "seed=4", "--seed", "5"]).expect("good");
    assert_eq!(args.settings::<Settings>([]).expect("settings").seed, 5, "flags go before --set");
}

#[test]
fn jobs_are_bounded() {
    assert_eq!(parse(&[]).map(|a| a.jobs), Ok(0));
    assert_eq!(parse(&["--jobs", "1"]).map(|a| a.jobs), Ok(1));
    for bad in ["1000000", "-1", "many"] {
        let message = parse(&[&format!("--jobs={bad}")]).expect_err(bad);
        assert!(message.contains("per core"), "{message}");
    }
}

#[test]
fn a_closed_pipe_is_no_error_and_a_full_disk_is() {
    struct Refuses(std::io::ErrorKind);
    impl Write for Refuses {
        fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
            Err(self.0.into())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    assert!(print_to(&mut Refuses(std::io::ErrorKind::BrokenPipe), "text").is_ok());
    assert!(print_to(&mut Refuses(std::io::ErrorKind::StorageFull), "text").is_err());
}

#[test]
fn completions_and_man_pages_know_the_flags() {
    for (kind, expected) in [("bash", "--distance"), ("zsh", "--below"), ("fish", "jobs"), ("man", "distance")] {
        let words = ["program", "--generate", kind].map(OsString::from);
        let (command, matches) = matches::<Cli>(words).expect("a command line");
        let mut text = Vec::new();
        assert!(generate::generate(&matches, command, &mut text).expect("memory"));
        assert!(String::from_utf8_lossy(&text).contains(expected), "{kind}");
    }
    assert!(parse(&["--generate", "tcsh"]).is_err());
    assert!(parse(&["--generate", "bash", "--seed", "1"]).is_err(), "alone on its command line");
}
