//! Positions as angles and lengths, as a user asks for them.
#![allow(clippy::approx_constant, clippy::print_stdout, clippy::unwrap_used)]

mod common;

use common::{json, run};
use serde_json::Value;

/// The record of one frame.
fn record(args: &str) -> Value {
    let (stdout, stderr, _) = run(&format!("read {args} -o json -q"));
    let mut records = json(&stdout);
    assert_eq!(records.len(), 1, "{args}: {stdout}{stderr}");
    records.remove(0)
}

const ROTARY: &str = "sim:motion=still,turn=3,pos=524288,frame=mt12,st20,nE,nW,crc6";
const LINEAR: &str = "sim:motion=still,pos=20001,frame=pos24,nE,nW,crc6";

#[test]
fn values_stand_beside_what_was_sent() {
    for (args, key, value) in [
        (ROTARY.to_owned(), "deg", 180.0),
        (format!("{ROTARY} --unit deg"), "deg", 180.0),
        (format!("{ROTARY} --unit deg --unwrap"), "deg", 1260.0),
        (format!("{ROTARY} --unit rad"), "rad", 3.1415927),
        (format!("{ROTARY} --unit turn"), "turns", 3.5),
        (format!("{ROTARY} --unit turn --zero 1048576"), "turns", 2.5),
        (format!("{ROTARY} --unit turn --reverse"), "turns", 4092.5),
        (
            format!("{ROTARY} --unit turn --resolution 1000000"),
            "turns",
            3.524288,
        ),
        (format!("{LINEAR} --resolution 50nm"), "mm", 1.00005),
        (
            format!("{LINEAR} --resolution 50nm --unit um"),
            "um",
            1000.05,
        ),
        (format!("{LINEAR} --resolution 2mm/8192"), "mm", 4.88306),
        (
            format!("{LINEAR} --resolution 50nm --zero 20002"),
            "mm",
            -0.00005,
        ),
        (
            format!("{LINEAR} --resolution 50nm --zero 20000 --reverse"),
            "mm",
            -0.00005,
        ),
        (format!("{LINEAR} --resolution 1000"), "deg", 0.36),
        (
            format!("{LINEAR} --resolution 1000 --unit turn"),
            "turns",
            20.001,
        ),
    ] {
        let record = record(&args);
        assert_eq!(record[key].as_f64(), Some(value), "{args}: {record}");
        let units = ["deg", "rad", "turns", "mm", "um"];
        let there = units.iter().filter(|unit| record.get(**unit).is_some());
        assert_eq!(there.count(), 1, "{args}: {record}");
        // What was sent is as it was sent, whatever is made of it.
        match args.starts_with(ROTARY) {
            true => assert_eq!(
                (&record["turn"], &record["pos"]),
                (&Value::from(3), &Value::from(524_288))
            ),
            false => assert_eq!(record["pos"], Value::from(20_001)),
        }
    }
    let bare = record(&format!("{ROTARY} --unit none"));
    assert!(
        bare.get("deg").is_none() && bare["pos"] == 524_288,
        "{bare}"
    );
}

#[test]
fn text_has_as_many_digits_as_the_resolution_needs() {
    for (args, shown) in [
        (
            format!("{ROTARY} --unit turn"),
            "pos 524288  3.50000000 turns  ok",
        ),
        (
            format!("{ROTARY} --unit rad"),
            "pos 524288  3.1415927 rad  ok",
        ),
        (
            format!("{LINEAR} --resolution 50nm"),
            "pos 20001  1.00005 mm  ok",
        ),
        (
            format!("{LINEAR} --resolution 50nm --unit um"),
            "pos 20001  1000.05 µm  ok",
        ),
        (
            format!("{LINEAR} --resolution 1um --zero 0"),
            "pos 20001  counts 20001  20.001 mm  ok",
        ),
    ] {
        let (stdout, stderr, status) = run(&format!("read {args}"));
        assert!(
            stdout.trim_end().ends_with(shown),
            "{args}: {stdout}{stderr}"
        );
        assert_eq!(status, Some(0));
    }
}

#[test]
fn columns_and_fields_have_the_name_of_the_unit() {
    let (stdout, _, _) = run(&format!("read {LINEAR} --resolution 50nm -o csv -q"));
    let lines: Vec<&str> = stdout.lines().collect();
    assert!(
        lines[0].starts_with("t_ns,seq,ok,pos,mm,error,"),
        "{stdout}"
    );
    assert!(
        lines[1].starts_with("0,0,true,20001,1.00005,false,"),
        "{stdout}"
    );
    let (stdout, _, _) = run(&format!("read {ROTARY} --unit turns -F turn,pos,turns"));
    assert_eq!(stdout, "3\t524288\t3.50000000\n");
    let (_, stderr, status) = run(&format!("read {ROTARY} --unit turns -F pos,deg"));
    assert!(
        stderr.contains("no `deg` in records of this frame, link and options"),
        "{stderr}"
    );
    assert_eq!(status, Some(2));
}

/// Turns that have fewer counts than their field: every sum is one of integers.
#[test]
fn turns_of_any_size_are_counted_exactly() {
    let mut rng = common::rng();
    for _ in 0..common::size(40) {
        let (bits, turns) = (rng.u8(8..=20), rng.u8(1..=12));
        let turn = rng.u64(100..=1 << bits);
        let (at, pos) = (rng.u64(..1 << turns), rng.u64(..turn));
        let range = turn << turns;
        let (zero, reverse) = (rng.u64(..range), rng.bool());
        let minus = if reverse { " --reverse" } else { "" };
        let args = format!(
            "sim:motion=still,turn={at},pos={pos},frame=mt{turns},st{bits},crc6 --resolution {turn} --zero {zero} --unit turn{minus}"
        );
        let record = record(&args);
        let away = i128::from(at * turn + pos) - i128::from(zero);
        let counts = if reverse { -away } else { away }.rem_euclid(i128::from(range)) as u64;
        assert_eq!(record["counts"], Value::from(counts), "{args}");
        let value = counts as f64 / turn as f64;
        let off = record["turns"].as_f64().unwrap() - value;
        assert!(off.abs() < 1.0 / turn as f64, "{args}: {record}");
        assert_eq!(
            (&record["turn"], &record["pos"]),
            (&Value::from(at), &Value::from(pos))
        );
    }
}

#[test]
fn a_position_beyond_its_turn_is_shown_and_not_measured() {
    let beyond = "sim:motion=still,pos=50000,frame=st16,crc6 --resolution 50000";
    let (stdout, stderr, status) = run(&format!("read {beyond} -o json -n 2 --zero 0"));
    for record in json(&stdout) {
        assert_eq!(record["pos"], Value::from(50_000));
        assert!(
            record.get("deg").is_none() && record.get("counts").is_none(),
            "{record}"
        );
    }
    assert_eq!(
        stderr.matches("beyond the counts that a turn has").count(),
        1,
        "{stderr}"
    );
    assert_eq!(status, Some(0));
    let (stdout, ..) = run(&format!("read {beyond} -q"));
    assert!(
        stdout.trim_end().ends_with("pos 50000  ok  unprotected")
            || stdout.trim_end().ends_with("pos 50000  ok"),
        "{stdout}"
    );
}

#[test]
fn what_does_not_fit_is_a_usage_error() {
    for (args, words) in [
        ("sim --unit mm", "takes the measuring step"),
        ("sim --unit rad --resolution 50nm", "is an angle"),
        ("sim:frame=pos24 --unit deg", "resolution 8192"),
        ("sim:frame=data8 --unit deg", "has none"),
        (
            "sim:frame=st12 --resolution 5000",
            "a turn cannot have more",
        ),
        ("sim --unit inch", "unknown unit `inch`"),
        ("sim --resolution 50", "biss"),
        ("sim --resolution 50km", "unknown unit `km`"),
    ] {
        let (stdout, stderr, status) = run(&format!("read {args}"));
        if words == "biss" {
            // A turn of 50 counts is odd, and may be.
            assert_eq!(status, Some(0), "{stderr}");
            continue;
        }
        assert!(
            stderr.contains(words) && stdout.is_empty(),
            "{args}: {stderr}"
        );
        assert_eq!(status, Some(2), "{args}");
    }
}
