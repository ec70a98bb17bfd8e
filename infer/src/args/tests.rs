use super::*;

#[test]
fn the_command_line_is_consistent() {
    use clap::CommandFactory;
    Args::command().debug_assert();
    let words = "infer --scan a b --from -1,0,2 0,-1,0 --json --depth d --pose -1,0,0,0,0,0,1 --misses free";
    let args = Args::from_command_line(words.split(' ').map(OsString::from)).expect("negative numbers are values");
    let from = [[-1., 0., 2.], [0., -1., 0.]].map(Origin::Point);
    assert_eq!((args.scan.len(), &args.from[..]), (2, &from[..]), "as given");
    assert!(args.json && args.pose.len() == 1 && args.misses == Some(NoReturn::Free), "flags stay flags");
}

#[test]
fn the_short_help_fits_a_screen_and_the_long_one_has_every_option() {
    use clap::CommandFactory;
    let mut command = Args::command();
    let (short, long) = (command.render_help().to_string(), command.render_long_help().to_string());
    assert!(short.lines().count() <= 64, "{short}");
    for option in command.get_opts() {
        let flag = format!("--{}", option.get_long().expect("a name"));
        assert!(long.contains(&flag) && (short.contains(&flag) || option.is_hide_short_help_set()), "{flag}");
        assert!(option.get_help_heading().is_some(), "{flag} is in no group");
    }
}

#[test]
fn flags_that_do_nothing_are_refused() {
    for (words, said) in [
        ("--http 127.0.0.1:0 --scan a", "--http"),
        ("--serve --json", "--json"),
        ("--scan a --views 3", "--views"),
        ("--scan a --export-scans d", "--export-scans"),
        ("--scan a --intrinsics 1,1,1,1", "--depth"),
        ("--depth d --from 1,2,3", "--scan"),
        ("--object m --unit mm", "--unit"),
        ("--object m --misses free", "--misses"),
        ("--scan a --state d", "--state"),
        ("--depth d --service-config s.toml", "--service-config"),
        ("--object m --state d", "--state"),
        ("--session s --state d", "--state"),
        ("--session s --service-config s.toml", "--service-config"),
        ("--session s --http 127.0.0.1:0", "--http"),
        ("--session s --ros2 base_link", "--ros2"),
        ("--session s --views 3", "--views"),
        ("--session s --export-scans d", "--export-scans"),
        ("--object m --plan-views 3", "--plan-views"),
        ("--serve --plan-views 3", "--plan-views"),
        ("--scan a --stop-below 2", "share from 0 to 1"),
        ("--scan a --plan p.csv --plan-views 0", "expected 1 to 100 views"),
        ("--scan a --plan p.csv --plan-views 101", "expected 1 to 100 views"),
        ("--scan a --distance -1", "length above 0"),
        ("--scan a --seed -1", "whole number"),
    ] {
        let error = Args::from_command_line(["infer"].into_iter().chain(words.split(' ')).map(OsString::from));
        let text = error.expect_err(words).to_string();
        assert!(text.contains(said), "{words}: {text}");
    }
}

#[test]
fn numbers_are_refused_with_the_reason() {
    assert_eq!(numbers::<3>("1, 2,-3e-1"), Ok([1.0, 2.0, -0.3]), "spaces are harmless");
    assert!(numbers::<3>("1,2").expect_err("two").contains("2 numbers, expected 3"), "count");
    assert!(numbers::<3>("1,x,3").expect_err("x").contains("\"x\""), "which");
    assert!(numbers::<3>("1,nan,3").is_err() && numbers::<3>("1,inf,3").is_err(), "finite only");
    assert_eq!(distances("0.6..1.2"), Ok((0.6, 1.2)), "a range");
    for bad in ["near", "-1", "0", "0.5..-1", "inf"] {
        assert!(distances(bad).expect_err(bad).contains("length above 0"), "{bad}");
    }
    assert!(distances("2..1").is_err(), "falling");
}

#[test]
fn scans_are_registered_by_flags() {
    let parse = |words: &str| Args::from_command_line(words.split(' ').map(OsString::from));
    let args = parse("infer --scan a b --register refine --pose-error 0.001,0.2").expect("flags");
    assert_eq!((args.register, args.pose_error), (Some(Register::Refine), Some([0.001, 0.2])));
    let wrong = parse("infer --scan a --register yes").expect_err("no mode").to_string();
    assert!(wrong.contains("off, check or refine"), "{wrong}");
}
