//! CSV, chosen fields and the user's own way of counting, as typed.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use common::{biss, run, texts};
use std::collections::{BTreeMap, BTreeSet};

/// The value of a key as it stands in a JSON record, without quotes. No value of ours has a comma.
fn raw<'a>(record: &'a str, key: &str) -> Option<&'a str> {
    let (_, rest) = record.split_once(&format!("\"{key}\":"))?;
    Some(rest.split([',', '}']).next()?.trim_matches('"'))
}

/// Rows of a CSV text, by column.
fn rows(csv: &str) -> (Vec<String>, Vec<BTreeMap<String, String>>) {
    let mut lines = csv.lines();
    let header: Vec<String> = lines
        .next()
        .unwrap()
        .split(',')
        .map(str::to_owned)
        .collect();
    let row = |line: &str| {
        let values: Vec<&str> = line.split(',').collect();
        assert_eq!(values.len(), header.len(), "{line}");
        let pairs = header
            .iter()
            .cloned()
            .zip(values.into_iter().map(str::to_owned));
        pairs.collect()
    };
    let rows = lines.map(row).collect();
    (header, rows)
}

/// Any way of counting.
fn counting(rng: &mut fastrand::Rng) -> Vec<&'static str> {
    let mut args = Vec::new();
    for option in ["--unwrap", "--reverse"] {
        if rng.bool() {
            args.push(option);
        }
    }
    args.extend(match rng.u8(..3) {
        0 => &["--zero", "here"][..],
        1 => &["--zero", "0"],
        _ => &[],
    });
    args
}

fn read(args: &[&str], more: &[&str]) -> String {
    let (stdout, stderr, status) = texts(biss(&[args, more].concat()).output().unwrap());
    assert!(status != Some(2), "{args:?}: {stderr}");
    stdout
}

/// JSON says it, CSV and fields repeat it; no row with a fault has anything that was measured.
#[test]
fn csv_and_fields_say_what_json_says() {
    const MEASURED: [&str; 9] = [
        "turn", "pos", "temp", "data", "lc", "counts", "deg", "error", "warning",
    ];
    let mut rng = common::rng();
    let mut seen = BTreeSet::new();
    for _ in 0..common::size(60).max(60) {
        let format = loop {
            let format = common::format(&mut rng);
            if format.contains("st") || format.contains("pos") {
                break format;
            }
        };
        let link = format!(
            "sim:crc-error=20%,no-ack=10%,null=20%,error=10%,flip=0.2%,busy=0us..9us,\
             motion=sine,period=1ms,degrees=170,seed={},frame={format}",
            rng.u32(..)
        );
        let count = counting(&mut rng);
        let time = *rng.choice(&["zero", "delta", "none"]).unwrap();
        let args = [&["read", &link, "-n", "30", "-t", time][..], &count].concat();
        let json = read(&args, &["-o", "json", "-v"]);
        let (header, rows) = rows(&read(&args, &["-o", "csv", "-v"]));
        assert_eq!(rows.len(), json.lines().count(), "a row a record");
        assert_eq!(header.contains(&"counts".to_owned()), !count.is_empty());
        for (row, record) in rows.iter().zip(json.lines()) {
            for (column, value) in row {
                let said = raw(record, column).unwrap_or_default();
                if column == "deg" && !value.is_empty() {
                    let (value, said): (f64, f64) = (value.parse().unwrap(), said.parse().unwrap());
                    assert!((value - said).abs() <= 1e-12 * said.abs(), "{record}");
                } else if column == "detail" {
                    for pair in value.split_whitespace() {
                        let (name, number) = pair.split_once('=').unwrap();
                        assert_eq!(raw(record, name), Some(number), "{record}");
                    }
                } else {
                    assert_eq!(value, said, "{column} in {record}");
                }
                seen.extend((!value.is_empty()).then(|| column.clone()));
            }
            // Every key has its column.
            for part in record.trim_matches(['{', '}']).split(',') {
                let key = part.split_once(':').unwrap().0.trim_matches('"');
                let number = row["detail"]
                    .split(' ')
                    .any(|pair| pair.split_once('=').is_some_and(|(name, _)| name == key));
                assert!(
                    key == "type" || number || header.contains(&key.to_owned()),
                    "{key} of {record} is in no column"
                );
            }
            if !row["fault"].is_empty() {
                assert_eq!(row["ok"], "false");
                for name in MEASURED.iter().filter_map(|name| row.get(*name)) {
                    assert_eq!(name, "", "{record}");
                }
            }
        }
        let fields: Vec<&str> = header
            .iter()
            .map(String::as_str)
            .filter(|name| !["fault", "detail"].contains(name))
            .collect();
        let lines = read(&args, &["-F", &fields.join(",")]);
        let good: Vec<String> = rows
            .iter()
            .filter(|row| row["fault"].is_empty())
            .map(|row| {
                let values: Vec<&str> = fields.iter().map(|name| row[*name].as_str()).collect();
                values.join("\t")
            })
            .collect();
        assert_eq!(lines.lines().collect::<Vec<_>>(), good, "{link}");
        let text = read(&args, &[]);
        for line in text.lines().filter(|line| line.contains("fault")) {
            assert!(
                !["pos ", "turn ", "counts ", "°"]
                    .iter()
                    .any(|word| line.contains(word)),
                "{line}"
            );
        }
    }
    for column in ["counts", "deg", "fault", "detail", "turn", "scd", "bits"] {
        assert!(seen.contains(column), "{column} was always empty: {seen:?}");
    }
}

/// Counts from what was printed, by arithmetic of another kind: turns and position first, then the shorter way.
#[test]
fn counts_follow_what_the_encoder_sent() {
    let mut rng = common::rng();
    let mut wraps = 0;
    for _ in 0..common::size(40).max(40) {
        let (mt, st) = (rng.u32(..4), rng.u32(4..24));
        let range = 1i128 << (mt + st);
        let turns = if mt > 0 {
            format!("mt{mt},")
        } else {
            String::new()
        };
        // Up to 0.36 turns a frame.
        let rpm = rng.i32(-72_000..72_000);
        let link = format!(
            "sim:fast,crc-error=10%,error=10%,rpm={rpm},pos={},seed={},frame={turns}st{st},nE,nW,crc6",
            rng.u64(..1 << st),
            rng.u32(..)
        );
        let zero = rng.u64(..1 << (mt + st)).to_string();
        let mut args = vec!["read", &link, "-n", "200", "-i", "300us", "-o", "json"];
        let (unwrap, reverse, here) = (rng.bool(), rng.bool(), rng.bool());
        args.extend(["--zero", if here { "here" } else { &zero }]);
        args.extend(unwrap.then_some("--unwrap"));
        args.extend(reverse.then_some("--reverse"));
        let mut zero = (!here).then(|| zero.parse::<i128>().unwrap());
        let mut place = None::<i128>;
        for record in read(&args, &[]).lines() {
            if raw(record, "ok") == Some("false") {
                assert_eq!(raw(record, "counts"), None, "{record}");
                assert_eq!(raw(record, "deg"), None, "{record}");
                continue;
            }
            let number = |key| raw(record, key).map_or(0, |n| n.parse::<i128>().unwrap());
            let sent = number("turn") * (1 << st) + number("pos");
            let zero = *zero.get_or_insert(sent);
            let last = place.unwrap_or(sent);
            let near = last - last.rem_euclid(range) + sent;
            // Of two that are as near, the one above.
            let candidates = [near + range, near, near - range];
            let nearest = *candidates
                .iter()
                .min_by_key(|there| (*there - last).abs())
                .unwrap();
            wraps += u32::from(nearest.div_euclid(range) != last.div_euclid(range));
            place = Some(nearest);
            let away = if unwrap { nearest } else { sent } - zero;
            let away = if reverse { -away } else { away };
            let want = if unwrap { away } else { away.rem_euclid(range) };
            assert_eq!(number("counts"), want, "{args:?} {record}");
            let degrees: f64 = raw(record, "deg").unwrap().parse().unwrap();
            let exact = want as f64 / f64::from(1 << st) * 360.0;
            let exact = if unwrap {
                exact
            } else {
                exact.rem_euclid(360.0)
            };
            assert!(
                (degrees - exact).abs() <= 360.0 / f64::from(1 << st),
                "{record}"
            );
        }
    }
    assert!(wraps > 50, "{wraps} rollovers only");
}

#[test]
fn the_header_is_there_whatever_comes() {
    let (stdout, _, status) = run("read sim:stuck=1 -o csv -q");
    assert_eq!(
        stdout,
        "t_ns,seq,ok,turn,pos,deg,error,warning,fault,detail,tries,ack,delay_clk,cds,crc,scd\n\
         0,0,false,,,,,,no-ack,clocks=40,1,,,,,\n"
    );
    assert_eq!(status, Some(1));
    let bench = "read file:tests/recordings/bench.vcd -o csv -q -f pos26,nE,nW,crc6";
    let header = |args: &str| run(args).0.lines().next().unwrap().to_owned();
    assert_eq!(
        header(bench),
        "t_ns,seq,ok,pos,error,warning,fault,detail,ack,delay_ns,busy_ns,clock_hz,timeout_ns,cds,crc,scd"
    );
    // Where there is no hardware, the names are told by what they are not.
    for (link, there, absent) in [
        ("wave:0.0", "delay_ns", "delay_clk"),
        ("spi:0.0", "delay_clk", "delay_ns"),
        ("gpio:0,ma=1,slo=2", "delay_clk", "delay_ns"),
    ] {
        let (_, said, _) = run(&format!("read {link} -f st8 -F -"));
        let names: Vec<&str> = said.split_whitespace().collect();
        assert!(names.contains(&there), "{link}: {said}");
        assert!(!names.contains(&absent), "{link}: {said}");
    }
    let union = "read sim:frame=data8=b,mt4,pos3,crc6+st9,data4=a,data2=b,lc4,E -o csv -v -t unix";
    assert_eq!(
        header(union),
        "t_unix_us,seq,ch,ok,turn,pos,b,a,lc,deg,error,fault,detail,tries,ack,delay_clk,cds,crc,unprotected,scd,bits"
    );
    let (stdout, stderr, _) = run("read sim -o csv -n 2");
    assert_eq!(stdout.lines().count(), 3);
    assert!(stderr.starts_with("biss: 2 frames, 2 good"), "{stderr}");
}

#[test]
fn fields_are_good_records_only() {
    let (stdout, stderr, status) = run("read sim:crc-error=50%,seed=2 -n 20 -F seq,pos,deg,error");
    let lines: Vec<&str> = stdout.lines().collect();
    assert!((1..20).contains(&lines.len()), "{stdout}");
    assert!(
        lines.iter().all(|line| line.split('\t').count() == 4),
        "{stdout}"
    );
    assert!(lines.iter().all(|line| line.ends_with("\tfalse")));
    assert!(stderr.contains("faults ("), "{stderr}");
    assert_eq!(status, Some(1));
    let both = run("read sim:frame=st8,crc5+data4=temp,crc5 -F ch,pos,temp,pos -q");
    let columns: Vec<Vec<&str>> = both.0.lines().map(|l| l.split('\t').collect()).collect();
    assert_eq!((columns[0][0], columns[0][2]), ("0", ""));
    assert_eq!((columns[1][0], columns[1][1], columns[1][3]), ("1", "", ""));
    assert!(!run("read sim --color always -F pos,ok").0.contains('\x1b'));
}

/// Before anything is opened, with the place marked and what there is.
#[test]
fn fields_that_are_not_there_are_usage() {
    for (args, mark, words) in [
        (
            "read sim -F pos,foo",
            "    pos,foo\n        ^^^\n",
            "no record has a `foo`",
        ),
        (
            "read sim -F turn,ch",
            "    turn,ch\n         ^^\n",
            "no `ch`",
        ),
        (
            "read spi:9.9 -f st9 -F turn",
            "    turn\n    ^^^^\n",
            "no `turn`",
        ),
        ("read sim -F t_ns -t none", "^^^^", "no `t_ns`"),
        ("read sim -F t_unix_us", "^^^^^^^^^", "no `t_unix_us`"),
        ("read sim -F counts", "^^^^^^", "no `counts`"),
        ("read sim -F delay_ns", "^^^^^^^^", "no `delay_ns`"),
        ("read file:no.vcd -f st9 -F tries", "^^^^^", "no `tries`"),
        (
            "read sim -F pos,,seq",
            "    pos,,seq\n        ^\n",
            "a name is missing",
        ),
        (
            "read sim -F pos,fault",
            "^^^^^",
            "good records have no `fault`",
        ),
        ("read sim -F type", "^^^^", "no record has a `type`"),
    ] {
        let (stdout, stderr, status) = run(args);
        assert_eq!((stdout.as_str(), status), ("", Some(2)), "{args}");
        for word in [mark, words, "there are ", " seq ok "] {
            assert!(stderr.contains(word), "{args}: no {word:?} in {stderr}");
        }
    }
    assert_eq!(run("read sim -F counts --reverse -q").2, Some(0));
    let (_, stderr, status) = run("read sim -F pos -o csv");
    assert!(stderr.contains("cannot be used with") && status == Some(2));
}

#[test]
fn counting_needs_something_to_count() {
    for (args, words) in [
        (
            "read sim:frame=data8,crc6 --unwrap",
            ["--unwrap counts a position", "stN or posN"],
        ),
        (
            "read sim:frame=data8,crc6 --zero here",
            ["--zero counts a position", "`data8,crc6`"],
        ),
        (
            "read sim:frame=mt8,crc6 --reverse",
            ["--reverse counts a position", "posN"],
        ),
        (
            "read sim:frame=st8,crc6 --zero 256",
            ["from 0 to 255", "--zero here"],
        ),
        (
            "read sim:frame=st12,crc6+st8,crc6 --zero 256",
            ["channel 1 counts from 0 to 255", "--zero here"],
        ),
        ("read sim --zero -3", ["`-3` is no position", "524288"]),
        ("read sim --zero home", ["`home` is no position", "or here"]),
    ] {
        let (stdout, stderr, status) = run(args);
        assert_eq!((stdout.as_str(), status), ("", Some(2)), "{args}: {stderr}");
        for word in words {
            assert!(stderr.contains(word), "{args}: no {word:?} in {stderr}");
        }
    }
    // The largest number there is, and a channel without a position beside one that has it.
    assert_eq!(run("read sim:frame=mt4,st8,crc6 --zero 4095 -q").2, Some(0));
    let (stdout, ..) = run("read sim:frame=st8,crc6+data8,crc6 --zero here -q -o json");
    let counted: Vec<bool> = stdout.lines().map(|l| l.contains("counts")).collect();
    assert_eq!(counted, [true, false]);
}

#[test]
fn a_step_too_long_is_said_once() {
    // 60 turns a minute, seen every 0.3 s and every half second.
    for (interval, words) in [
        ("300ms", "a quarter of its range or more"),
        ("500ms", "half its range"),
    ] {
        let args = format!("read sim:fast,frame=st8,nE,nW,crc6 --unwrap -n 9 -i {interval}");
        let (_, stderr, _) = run(&args);
        assert_eq!(stderr.matches(words).count(), 1, "{stderr}");
        assert!(!run(&format!("{args} -q")).1.contains(words));
        assert!(
            !run(&args.replace("--unwrap", "--zero here"))
                .1
                .contains(words)
        );
    }
    let (_, stderr, _) = run("read sim:fast,frame=st8,nE,nW,crc6 --unwrap -n 9 -i 100ms");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
}

/// Whole turns go by while faults or the error bit hide them: the number that comes next looks near.
#[test]
fn a_gap_too_long_is_said_once() {
    const SAYS: &str = "good frames were so far apart";
    for trouble in ["no-ack", "error", "null"] {
        let link = |often: &str| {
            format!("sim:fast,rpm=600,seed=3,{trouble}={often},frame=st12,nE,nW,crc6")
        };
        let gaps = format!("read {} -n 200 -i 10ms", link("85%"));
        let said = |args: &str| run(args).1.matches(SAYS).count();
        assert_eq!(said(&format!("{gaps} --unwrap")), 1, "{trouble}");
        assert_eq!(said(&format!("{gaps} --unwrap -q")), 0, "{trouble}");
        assert_eq!(said(&format!("{gaps} --zero here")), 0, "{trouble}");
        // Nobody is told of a gap in which it cannot have gone far.
        let short = format!("read {} -n 200 -i 100us --unwrap", link("20%"));
        assert_eq!(said(&short), 0, "{trouble}");
    }
}
