# Print an optspec for argparse to handle cmd's options that are independent of any subcommand.
function __fish_biss_global_optspecs
    string join \n h/help V/version
end

function __fish_biss_needs_command
    # Figure out if the current invocation already has a command.
    set -l cmd (commandline -opc)
    set -e cmd[1]
    argparse -s (__fish_biss_global_optspecs) -- $cmd 2>/dev/null
    or return
    if set -q argv[1]
        # Also print the command, so this can be used to figure out what it is.
        echo $argv[1]
        return 1
    end
    return 0
end

function __fish_biss_using_subcommand
    set -l cmd (__fish_biss_needs_command)
    test -z "$cmd"
    and return 1
    contains -- $cmd[1] $argv
end

complete -c biss -n "__fish_biss_needs_command" -s h -l help -d 'Print help'
complete -c biss -n "__fish_biss_needs_command" -s V -l version -d 'Print version'
complete -c biss -n "__fish_biss_needs_command" -f -a "list" -d 'What this machine offers, what is missing, and what helps'
complete -c biss -n "__fish_biss_needs_command" -f -a "read" -d 'Read frames and print them, one record a line'
complete -c biss -n "__fish_biss_needs_command" -f -a "stats" -d 'Many frames in a few numbers: rate, jitter, line delay, margins, faults, noise'
complete -c biss -n "__fish_biss_needs_command" -f -a "watch" -d 'A live view for the bench: position, angle, speed, rate, jitter, faults'
complete -c biss -n "__fish_biss_needs_command" -f -a "detect" -d 'What an unknown encoder sends: frame format, CRC, Ack, timeout, usable clock'
complete -c biss -n "__fish_biss_needs_command" -f -a "scope" -d 'Draw cycles as a data sheet does: both wires, and what each bit of them is'
complete -c biss -n "__fish_biss_needs_command" -f -a "capture" -d 'Record MA and SLO: VCD, sigrok session or CSV'
complete -c biss -n "__fish_biss_needs_command" -f -a "reg" -d 'Registers of the slaves: read, write, dump, save, load'
complete -c biss -n "__fish_biss_needs_command" -f -a "command" -d 'Tell slaves to do something'
complete -c biss -n "__fish_biss_needs_command" -f -a "info" -d 'Who is on the line: IDs, serial numbers, EDS, profiles, and the frame that follows'
complete -c biss -n "__fish_biss_needs_command" -f -a "loopback" -d 'The master against a slave of its own: in process, or over jumpered pins'
complete -c biss -n "__fish_biss_needs_command" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c biss -n "__fish_biss_using_subcommand list" -s o -l format -d 'How it is told' -r -f -a "text\t'For people'
json\t'JSON Lines'"
complete -c biss -n "__fish_biss_using_subcommand list" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand list" -s v -l verbose -d 'Free lines too, and all about presets; JSON has everything anyway'
complete -c biss -n "__fish_biss_using_subcommand list" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand read" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand read" -s f -l frame -d 'Frame format, such as mt12,st20,nE,nW,crc6, the name of a preset, or auto: what the slaves\' registers say' -r -f -a "balluff-bml-s1g0\t'Balluff BML-S1G0-B, magnetic linear, 28 bit'
balluff-bml-sl1\t'Balluff BML SL1-ALZ1-B, magnetic linear, 24 bit'
faulhaber-aemt\t'Faulhaber AEMT-12/16 L, magnetic, 16 bit of turns, 12 bit a turn'
lenz-irs\t'Lenz IRS and SAB, inductive ring, 24 bit'
lika-amm3616\t'Lika AMM3616/4096SC, 12 bit of turns, 16 bit a turn'
lika-amm3619\t'Lika AMM3619/4096SC, 12 bit of turns, 19 bit a turn'
lika-sma1\t'Lika SMA1, magnetic linear, 24 bit'
resolute-18\t'Renishaw RESOLUTE, optical, 18 bit'
resolute-26\t'Renishaw RESOLUTE, optical, 26 bit'
resolute-32\t'Renishaw RESOLUTE, optical, 32 bit'
resolute-36\t'Renishaw RESOLUTE, optical, 36 bit'
siko-msa213c\t'Siko MSA213C, magnetic linear, 25 bit'
auto\t'what the slaves\' registers say'"
complete -c biss -n "__fish_biss_using_subcommand read" -s n -l count -d 'Number of frames, 0 for no end [default: 1, all of a recording]' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -s i -l interval -d 'From start to start; missed slots are skipped and counted [default: back to back]' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l retries -d 'Repetitions of a bad frame per slot [default: 3 for stalled, else 0]' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l wait -d 'How long to wait for a first good frame [default: 0s, or what a preset takes after power-on]' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -s o -l format -d 'How records look' -r -f -a "text\t'For people'
json\t'JSON Lines'
csv\t'Comma-separated values, a header first'"
complete -c biss -n "__fish_biss_using_subcommand read" -s F -l fields -d 'Tab-separated values of good records only: LIST is keys of the JSON records, such as t_ns,pos,deg' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l registers -d 'Read these registers beside the frames, again and again [-n: until all are read once]' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l slave -d 'Whose registers: ID 0 is the slave farthest away' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l zero -d 'What counts as 0, as the encoder sends it, or the first good frame: adds counts' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l resolution -d 'Counts of a turn, where a field has room for more, or the measuring step of a linear encoder: 50nm, 2mm/8192' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -l unit -d 'Measure positions in deg, rad, turns, mm, um, or none [default: deg of st fields, mm with a measuring step]' -r -f
complete -c biss -n "__fish_biss_using_subcommand read" -s t -l time -d 'Time stamps' -r -f -a "zero\t'Since the first frame'
delta\t'Since the frame before'
unix\t'Since 1970'
none\t'None'"
complete -c biss -n "__fish_biss_using_subcommand read" -l color -d 'Colours in text output' -r -f -a "auto\t'On a terminal, unless NO_COLOR is set'
always\t'Always'
never\t'Never'"
complete -c biss -n "__fish_biss_using_subcommand read" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand read" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand read" -l unwrap -d 'Count on where the position rolls over, less than half its range a frame: adds counts'
complete -c biss -n "__fish_biss_using_subcommand read" -l reverse -d 'Count against the encoder\'s direction: adds counts'
complete -c biss -n "__fish_biss_using_subcommand read" -l no-reverse -d 'Count in the encoder\'s direction, whatever a named encoder says'
complete -c biss -n "__fish_biss_using_subcommand read" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand stats" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand stats" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand stats" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand stats" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand stats" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand stats" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand stats" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand stats" -s f -l frame -d 'Frame format, such as mt12,st20,nE,nW,crc6, the name of a preset, or auto: what the slaves\' registers say' -r -f -a "balluff-bml-s1g0\t'Balluff BML-S1G0-B, magnetic linear, 28 bit'
balluff-bml-sl1\t'Balluff BML SL1-ALZ1-B, magnetic linear, 24 bit'
faulhaber-aemt\t'Faulhaber AEMT-12/16 L, magnetic, 16 bit of turns, 12 bit a turn'
lenz-irs\t'Lenz IRS and SAB, inductive ring, 24 bit'
lika-amm3616\t'Lika AMM3616/4096SC, 12 bit of turns, 16 bit a turn'
lika-amm3619\t'Lika AMM3619/4096SC, 12 bit of turns, 19 bit a turn'
lika-sma1\t'Lika SMA1, magnetic linear, 24 bit'
resolute-18\t'Renishaw RESOLUTE, optical, 18 bit'
resolute-26\t'Renishaw RESOLUTE, optical, 26 bit'
resolute-32\t'Renishaw RESOLUTE, optical, 32 bit'
resolute-36\t'Renishaw RESOLUTE, optical, 36 bit'
siko-msa213c\t'Siko MSA213C, magnetic linear, 25 bit'
auto\t'what the slaves\' registers say'"
complete -c biss -n "__fish_biss_using_subcommand stats" -s i -l interval -d 'From start to start; missed slots are skipped and counted [default: back to back]' -r -f
complete -c biss -n "__fish_biss_using_subcommand stats" -l retries -d 'Repetitions of a bad frame per slot [default: 3 for stalled, else 0]' -r -f
complete -c biss -n "__fish_biss_using_subcommand stats" -l wait -d 'How long to wait for a first good frame [default: 0s, or what a preset takes after power-on]' -r -f
complete -c biss -n "__fish_biss_using_subcommand stats" -l resolution -d 'Counts of a turn, where a field has room for more, or the measuring step of a linear encoder: 50nm, 2mm/8192' -r -f
complete -c biss -n "__fish_biss_using_subcommand stats" -l unit -d 'Measure positions in deg, rad, turns, mm, um, or none [default: deg of st fields, mm with a measuring step]' -r -f
complete -c biss -n "__fish_biss_using_subcommand stats" -s o -l format -d 'How it is told' -r -f -a "text\t'For people'
json\t'JSON Lines'"
complete -c biss -n "__fish_biss_using_subcommand stats" -s n -l count -d 'Number of frames, 0 for no end [default: 1000, all of a recording]' -r -f
complete -c biss -n "__fish_biss_using_subcommand stats" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand stats" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand stats" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand watch" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand watch" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand watch" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand watch" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand watch" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand watch" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand watch" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand watch" -s f -l frame -d 'Frame format, such as mt12,st20,nE,nW,crc6, the name of a preset, or auto: what the slaves\' registers say' -r -f -a "balluff-bml-s1g0\t'Balluff BML-S1G0-B, magnetic linear, 28 bit'
balluff-bml-sl1\t'Balluff BML SL1-ALZ1-B, magnetic linear, 24 bit'
faulhaber-aemt\t'Faulhaber AEMT-12/16 L, magnetic, 16 bit of turns, 12 bit a turn'
lenz-irs\t'Lenz IRS and SAB, inductive ring, 24 bit'
lika-amm3616\t'Lika AMM3616/4096SC, 12 bit of turns, 16 bit a turn'
lika-amm3619\t'Lika AMM3619/4096SC, 12 bit of turns, 19 bit a turn'
lika-sma1\t'Lika SMA1, magnetic linear, 24 bit'
resolute-18\t'Renishaw RESOLUTE, optical, 18 bit'
resolute-26\t'Renishaw RESOLUTE, optical, 26 bit'
resolute-32\t'Renishaw RESOLUTE, optical, 32 bit'
resolute-36\t'Renishaw RESOLUTE, optical, 36 bit'
siko-msa213c\t'Siko MSA213C, magnetic linear, 25 bit'
auto\t'what the slaves\' registers say'"
complete -c biss -n "__fish_biss_using_subcommand watch" -l retries -d 'Repetitions of a bad frame per slot [default: 3 for stalled, else 0]' -r -f
complete -c biss -n "__fish_biss_using_subcommand watch" -l wait -d 'How long to wait for a first good frame [default: 0s, or what a preset takes after power-on]' -r -f
complete -c biss -n "__fish_biss_using_subcommand watch" -l resolution -d 'Counts of a turn, where a field has room for more, or the measuring step of a linear encoder: 50nm, 2mm/8192' -r -f
complete -c biss -n "__fish_biss_using_subcommand watch" -l unit -d 'Measure positions in deg, rad, turns, mm, um, or none [default: deg of st fields, mm with a measuring step]' -r -f
complete -c biss -n "__fish_biss_using_subcommand watch" -l color -d 'Colours' -r -f -a "auto\t'On a terminal, unless NO_COLOR is set'
always\t'Always'
never\t'Never'"
complete -c biss -n "__fish_biss_using_subcommand watch" -s n -l count -d 'Number of frames, 0 for no end [default: 0]' -r -f
complete -c biss -n "__fish_biss_using_subcommand watch" -s i -l interval -d 'From start to start; missed slots are skipped and counted [default: 10ms]' -r -f
complete -c biss -n "__fish_biss_using_subcommand watch" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand watch" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand watch" -l ascii -d 'Lines of - and # even where the locale knows better ones'
complete -c biss -n "__fish_biss_using_subcommand watch" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand detect" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand detect" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand detect" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand detect" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand detect" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand detect" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand detect" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand detect" -s n -l count -d 'Most frames to look at; fewer where they are certain [default: 1000, all of a recording]' -r -f
complete -c biss -n "__fish_biss_using_subcommand detect" -l wait -d 'How long to wait for motion where a position that stands still leaves several formats [default: 10s, 0s with -n or on sim]' -r -f
complete -c biss -n "__fish_biss_using_subcommand detect" -l save -d 'Where exactly one format fits, keep link, format and clock under this name: `biss read NAME` reads it then' -r -f
complete -c biss -n "__fish_biss_using_subcommand detect" -s o -l format -d 'How it is told' -r -f -a "text\t'For people'
json\t'JSON Lines'"
complete -c biss -n "__fish_biss_using_subcommand detect" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand detect" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand detect" -l no-write -d 'Do not even select a bank to ask for the EDS'
complete -c biss -n "__fish_biss_using_subcommand detect" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand scope" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand scope" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand scope" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand scope" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand scope" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand scope" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand scope" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand scope" -s f -l frame -d 'Frame format, such as mt12,st20,nE,nW,crc6, the name of a preset, or auto; without one the bits are drawn' -r -f -a "balluff-bml-s1g0\t'Balluff BML-S1G0-B, magnetic linear, 28 bit'
balluff-bml-sl1\t'Balluff BML SL1-ALZ1-B, magnetic linear, 24 bit'
faulhaber-aemt\t'Faulhaber AEMT-12/16 L, magnetic, 16 bit of turns, 12 bit a turn'
lenz-irs\t'Lenz IRS and SAB, inductive ring, 24 bit'
lika-amm3616\t'Lika AMM3616/4096SC, 12 bit of turns, 16 bit a turn'
lika-amm3619\t'Lika AMM3619/4096SC, 12 bit of turns, 19 bit a turn'
lika-sma1\t'Lika SMA1, magnetic linear, 24 bit'
resolute-18\t'Renishaw RESOLUTE, optical, 18 bit'
resolute-26\t'Renishaw RESOLUTE, optical, 26 bit'
resolute-32\t'Renishaw RESOLUTE, optical, 32 bit'
resolute-36\t'Renishaw RESOLUTE, optical, 36 bit'
siko-msa213c\t'Siko MSA213C, magnetic linear, 25 bit'
auto\t'what the slaves\' registers say'"
complete -c biss -n "__fish_biss_using_subcommand scope" -s n -l count -d 'Number of cycles to draw' -r -f
complete -c biss -n "__fish_biss_using_subcommand scope" -l skip -l seq -d 'Cycles to leave out before: the first one drawn has this seq in the records of read' -r -f
complete -c biss -n "__fish_biss_using_subcommand scope" -l at -d 'Begin with the first cycle at this time or later, as read shows it: since the first cycle' -r -f
complete -c biss -n "__fish_biss_using_subcommand scope" -l within -d 'Cycles to look at for a fault [default: 10000, all of a recording]' -r -f
complete -c biss -n "__fish_biss_using_subcommand scope" -s w -l write -d 'Write an SVG instead, - for standard output' -r -F
complete -c biss -n "__fish_biss_using_subcommand scope" -l width -d 'Length of the lines [default: the terminal\'s, COLUMNS, else 80]' -r -f
complete -c biss -n "__fish_biss_using_subcommand scope" -l color -d 'Colours' -r -f -a "auto\t'On a terminal, unless NO_COLOR is set'
always\t'Always'
never\t'Never'"
complete -c biss -n "__fish_biss_using_subcommand scope" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand scope" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand scope" -l fault -d 'Draw the first cycle with a fault; -n draws those behind it too'
complete -c biss -n "__fish_biss_using_subcommand scope" -l ascii -d 'Lines of - and + even where the locale knows better ones'
complete -c biss -n "__fish_biss_using_subcommand scope" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand capture" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand capture" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand capture" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand capture" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand capture" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand capture" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand capture" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand capture" -s w -l write -d 'The recording, - for standard output' -r -F
complete -c biss -n "__fish_biss_using_subcommand capture" -l as -d 'What kind of recording [default: by the end of FILE\'s name]' -r -f -a "vcd\t'Value change dump'
sr\t'sigrok session'
csv\t'Comma-separated values, a row a change'"
complete -c biss -n "__fish_biss_using_subcommand capture" -l sample-rate -d 'Samples a second of a .sr [default: a usual rate, 16 samples a clock at least]' -r -f
complete -c biss -n "__fish_biss_using_subcommand capture" -s f -l frame -d 'Frame format, such as mt12,st20,nE,nW,crc6, or the name of a preset [default: nothing is decoded but Ack and start]' -r -f -a "balluff-bml-s1g0\t'Balluff BML-S1G0-B, magnetic linear, 28 bit'
balluff-bml-sl1\t'Balluff BML SL1-ALZ1-B, magnetic linear, 24 bit'
faulhaber-aemt\t'Faulhaber AEMT-12/16 L, magnetic, 16 bit of turns, 12 bit a turn'
lenz-irs\t'Lenz IRS and SAB, inductive ring, 24 bit'
lika-amm3616\t'Lika AMM3616/4096SC, 12 bit of turns, 16 bit a turn'
lika-amm3619\t'Lika AMM3619/4096SC, 12 bit of turns, 19 bit a turn'
lika-sma1\t'Lika SMA1, magnetic linear, 24 bit'
resolute-18\t'Renishaw RESOLUTE, optical, 18 bit'
resolute-26\t'Renishaw RESOLUTE, optical, 26 bit'
resolute-32\t'Renishaw RESOLUTE, optical, 32 bit'
resolute-36\t'Renishaw RESOLUTE, optical, 36 bit'
siko-msa213c\t'Siko MSA213C, magnetic linear, 25 bit'"
complete -c biss -n "__fish_biss_using_subcommand capture" -l clocks -d 'Clocks a frame, whatever comes [default: as many as the format needs, 128 without one]' -r -f
complete -c biss -n "__fish_biss_using_subcommand capture" -s n -l count -d 'Number of frames, 0 for no end [default: 1, all of a recording]' -r -f
complete -c biss -n "__fish_biss_using_subcommand capture" -s i -l interval -d 'From start to start; missed slots are skipped and counted [default: back to back]' -r -f
complete -c biss -n "__fish_biss_using_subcommand capture" -l retries -d 'Repetitions of a bad frame per slot [default: 3 for stalled, else 0]' -r -f
complete -c biss -n "__fish_biss_using_subcommand capture" -l wait -d 'How long to wait for a first good frame [default: 0s, or what a preset takes after power-on]' -r -f
complete -c biss -n "__fish_biss_using_subcommand capture" -s o -l format -d 'Print the frames too, as biss read does' -r -f -a "text\t'For people'
json\t'JSON Lines'
csv\t'Comma-separated values, a header first'"
complete -c biss -n "__fish_biss_using_subcommand capture" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand capture" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand capture" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -l retries -d 'Control frames without progress that are repeated' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -l slave -d 'Whose registers: ID 0 is the slave farthest away [default: 0; load: the file\'s]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -l bank -d 'Bank to be selected for the work; save takes several, load means that one of the file' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -s o -l format -d 'How records look' -r -f -a "text\t'For people'
json\t'JSON Lines'"
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -l verify -d 'Read everything twice: a CRC of four bits lets some errors of three bits pass'
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -f -a "read" -d 'Read registers, one record each'
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -f -a "write" -d 'Write registers in this order, and read them back: one record each with the old and the new value'
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -f -a "dump" -d 'All registers as a table: hexadecimal and ASCII, -- is refused, XX could not be read'
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -f -a "save" -d 'Save 0x00 to 0x3f of a bank, or of several, in a file that load takes'
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -f -a "load" -d 'Write what differs from a saved file, and read everything back'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -l retries -d 'Control frames without progress that are repeated' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -l slave -d 'Whose registers: ID 0 is the slave farthest away [default: 0; load: the file\'s]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -l bank -d 'Bank to be selected for the work; save takes several, load means that one of the file' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -s o -l format -d 'How records look' -r -f -a "text\t'For people'
json\t'JSON Lines'"
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -l verify -d 'Read everything twice: a CRC of four bits lets some errors of three bits pass'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from read" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -l retries -d 'Control frames without progress that are repeated' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -l slave -d 'Whose registers: ID 0 is the slave farthest away [default: 0; load: the file\'s]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -l bank -d 'Bank to be selected for the work; save takes several, load means that one of the file' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -s o -l format -d 'How records look' -r -f -a "text\t'For people'
json\t'JSON Lines'"
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -l unchecked -d 'Do not read them back: for registers that do not keep what is written'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -l verify -d 'Read everything twice: a CRC of four bits lets some errors of three bits pass'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from write" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -l retries -d 'Control frames without progress that are repeated' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -l slave -d 'Whose registers: ID 0 is the slave farthest away [default: 0; load: the file\'s]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -l bank -d 'Bank to be selected for the work; save takes several, load means that one of the file' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -s o -l format -d 'How records look' -r -f -a "text\t'For people'
json\t'JSON Lines'"
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -l verify -d 'Read everything twice: a CRC of four bits lets some errors of three bits pass'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from dump" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -s w -l write -d 'The file, - for standard output; what is there is replaced once all is read' -r -F
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -l retries -d 'Control frames without progress that are repeated' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -l slave -d 'Whose registers: ID 0 is the slave farthest away [default: 0; load: the file\'s]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -l bank -d 'Bank to be selected for the work; save takes several, load means that one of the file' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -s o -l format -d 'How records look' -r -f -a "text\t'For people'
json\t'JSON Lines'"
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -l verify -d 'Read everything twice: a CRC of four bits lets some errors of three bits pass'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from save" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -l retries -d 'Control frames without progress that are repeated' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -l slave -d 'Whose registers: ID 0 is the slave farthest away [default: 0; load: the file\'s]' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -l bank -d 'Bank to be selected for the work; save takes several, load means that one of the file' -r -f
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -s o -l format -d 'How records look' -r -f -a "text\t'For people'
json\t'JSON Lines'"
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -l dry-run -d 'Only show what differs'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -l force -d 'Though the file was saved from another kind of device'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -l verify -d 'Read everything twice: a CRC of four bits lets some errors of three bits pass'
complete -c biss -n "__fish_biss_using_subcommand reg; and __fish_seen_subcommand_from load" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand command" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand command" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand command" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand command" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand command" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand command" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand command" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand command" -l retries -d 'Control frames without progress that are repeated' -r -f
complete -c biss -n "__fish_biss_using_subcommand command" -l slave -d 'For these slaves: ID 0 is the one farthest away' -r -f
complete -c biss -n "__fish_biss_using_subcommand command" -s o -l format -d 'How the record looks' -r -f -a "text\t'For people'
json\t'JSON Lines'"
complete -c biss -n "__fish_biss_using_subcommand command" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand command" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand command" -l broadcast -d 'For all slaves, none of which acknowledges it'
complete -c biss -n "__fish_biss_using_subcommand command" -l unchecked -d 'Execute whoever acknowledges it'
complete -c biss -n "__fish_biss_using_subcommand command" -l reduced -d 'In frames of two clocks, which slaves understand whose data channels are off'
complete -c biss -n "__fish_biss_using_subcommand command" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand info" -s c -l clock -d 'Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]' -r -f
complete -c biss -n "__fish_biss_using_subcommand info" -l timeout -d 'The slave\'s timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]' -r -f
complete -c biss -n "__fish_biss_using_subcommand info" -l ack-limit -d 'How long Ack is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand info" -l busy-limit -d 'How long the start bit is searched, eight clocks at least' -r -f
complete -c biss -n "__fish_biss_using_subcommand info" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand info" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand info" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand info" -l retries -d 'Control frames without progress that are repeated' -r -f
complete -c biss -n "__fish_biss_using_subcommand info" -s o -l format -d 'How it is told' -r -f -a "text\t'For people'
json\t'JSON Lines'"
complete -c biss -n "__fish_biss_using_subcommand info" -s q -l quiet -d 'No summary and no notes on stderr'
complete -c biss -n "__fish_biss_using_subcommand info" -s v -l verbose -d 'Say how the link runs, and what it took; where records are printed, add the bits'
complete -c biss -n "__fish_biss_using_subcommand info" -l no-write -d 'Do not even select a bank: what is in others is left out'
complete -c biss -n "__fish_biss_using_subcommand info" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand loopback" -l config -d 'Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]' -r -F
complete -c biss -n "__fish_biss_using_subcommand loopback" -s f -l frame -d 'Frame format of the slave, or a preset' -r -f -a "balluff-bml-s1g0\t'Balluff BML-S1G0-B, magnetic linear, 28 bit'
balluff-bml-sl1\t'Balluff BML SL1-ALZ1-B, magnetic linear, 24 bit'
faulhaber-aemt\t'Faulhaber AEMT-12/16 L, magnetic, 16 bit of turns, 12 bit a turn'
lenz-irs\t'Lenz IRS and SAB, inductive ring, 24 bit'
lika-amm3616\t'Lika AMM3616/4096SC, 12 bit of turns, 16 bit a turn'
lika-amm3619\t'Lika AMM3619/4096SC, 12 bit of turns, 19 bit a turn'
lika-sma1\t'Lika SMA1, magnetic linear, 24 bit'
resolute-18\t'Renishaw RESOLUTE, optical, 18 bit'
resolute-26\t'Renishaw RESOLUTE, optical, 26 bit'
resolute-32\t'Renishaw RESOLUTE, optical, 32 bit'
resolute-36\t'Renishaw RESOLUTE, optical, 36 bit'
siko-msa213c\t'Siko MSA213C, magnetic linear, 25 bit'"
complete -c biss -n "__fish_biss_using_subcommand loopback" -s c -l clock -d 'The only frequency of MA to try' -r -f
complete -c biss -n "__fish_biss_using_subcommand loopback" -s n -l count -d 'Frames, or on wave transfers, at each clock [default: 1000 in process, 100 over lines, 8 on wave]' -r -f
complete -c biss -n "__fish_biss_using_subcommand loopback" -l search -d 'Where else to look for MA and the slave\'s SLO when a jumper is on the wrong line; each becomes an input' -r -f
complete -c biss -n "__fish_biss_using_subcommand loopback" -s o -l format -d 'How it is told' -r -f -a "text\t'For people'
json\t'JSON Lines'"
complete -c biss -n "__fish_biss_using_subcommand loopback" -l rt -d 'Real-time priority (SCHED_FIFO), memory locked' -r -f
complete -c biss -n "__fish_biss_using_subcommand loopback" -l cpu -d 'Run on this processor only' -r -f
complete -c biss -n "__fish_biss_using_subcommand loopback" -s q -l quiet -d 'No summary on stderr'
complete -c biss -n "__fish_biss_using_subcommand loopback" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c biss -n "__fish_biss_using_subcommand help; and not __fish_seen_subcommand_from list read stats watch detect scope capture reg command info loopback help" -f -a "list" -d 'What this machine offers, what is missing, and what helps'
complete -c biss -n "__fish_biss_using_subcommand help; and not __fish_seen_subcommand_from list read stats watch detect scope capture reg command info loopback help" -f -a "read" -d 'Read frames and print them, one record a line'
complete -c biss -n "__fish_biss_using_subcommand help; and not __fish_seen_subcommand_from list read stats watch detect scope capture reg command info loopback help" -f -a "stats" -d 'Many frames in a few numbers: rate, jitter, line delay, margins, faults, noise'
complete -c biss -n "__fish_biss_using_subcommand help; and not __fish_seen_subcommand_from list read stats watch detect scope capture reg command info loopback help" -f -a "watch" -d 'A live view for the bench: position, angle, speed, rate, jitter, faults'
complete -c biss -n "__fish_biss_using_subcommand help; and not __fish_seen_subcommand_from list read stats watch detect scope capture reg command info loopback help" -f -a "detect" -d 'What an unknown encoder sends: frame format, CRC, Ack, timeout, usable clock'
complete -c biss -n "__fish_biss_using_subcommand help; and not __fish_seen_subcommand_from list read stats watch detect scope capture reg command info loopback help" -f -a "scope" -d 'Draw cycles as a data sheet does: both wires, and what each bit of them is'
complete -c biss -n "__fish_biss_using_subcommand help; and not __fish_seen_subcommand_from list read stats watch detect scope capture reg command info loopback help" -f -a "capture" -d 'Record MA and SLO: VCD, sigrok session or CSV'
complete -c biss -n "__fish_biss_using_subcommand help; and not __fish_seen_subcommand_from list read stats watch detect scope capture reg command info loopback help" -f -a "reg" -d 'Registers of the slaves: read, write, dump, save, load'
complete -c biss -n "__fish_biss_using_subcommand help; and not __fish_seen_subcommand_from list read stats watch detect scope capture reg command info loopback help" -f -a "command" -d 'Tell slaves to do something'
complete -c biss -n "__fish_biss_using_subcommand help; and not __fish_seen_subcommand_from list read stats watch detect scope capture reg command info loopback help" -f -a "info" -d 'Who is on the line: IDs, serial numbers, EDS, profiles, and the frame that follows'
complete -c biss -n "__fish_biss_using_subcommand help; and not __fish_seen_subcommand_from list read stats watch detect scope capture reg command info loopback help" -f -a "loopback" -d 'The master against a slave of its own: in process, or over jumpered pins'
complete -c biss -n "__fish_biss_using_subcommand help; and not __fish_seen_subcommand_from list read stats watch detect scope capture reg command info loopback help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c biss -n "__fish_biss_using_subcommand help; and __fish_seen_subcommand_from reg" -f -a "read" -d 'Read registers, one record each'
complete -c biss -n "__fish_biss_using_subcommand help; and __fish_seen_subcommand_from reg" -f -a "write" -d 'Write registers in this order, and read them back: one record each with the old and the new value'
complete -c biss -n "__fish_biss_using_subcommand help; and __fish_seen_subcommand_from reg" -f -a "dump" -d 'All registers as a table: hexadecimal and ASCII, -- is refused, XX could not be read'
complete -c biss -n "__fish_biss_using_subcommand help; and __fish_seen_subcommand_from reg" -f -a "save" -d 'Save 0x00 to 0x3f of a bank, or of several, in a file that load takes'
complete -c biss -n "__fish_biss_using_subcommand help; and __fish_seen_subcommand_from reg" -f -a "load" -d 'Write what differs from a saved file, and read everything back'
complete -c biss -n "__fish_biss_using_subcommand read" -a "gpio:\t'two GPIO lines'
spi:\t'spidev: SCLK is MA, MISO is SLO'
wave:\t'spidev: MOSI is MA, MISO is SLO'
sim\t'simulated encoder'
file:\t'recording: sigrok session, VCD, CSV'
exec:\t'a slave in another process, such as an HDL simulator'
NAME\t'an encoder of the configuration'"
complete -c biss -n "__fish_biss_using_subcommand stats" -a "gpio:\t'two GPIO lines'
spi:\t'spidev: SCLK is MA, MISO is SLO'
wave:\t'spidev: MOSI is MA, MISO is SLO'
sim\t'simulated encoder'
file:\t'recording: sigrok session, VCD, CSV'
exec:\t'a slave in another process, such as an HDL simulator'
NAME\t'an encoder of the configuration'"
complete -c biss -n "__fish_biss_using_subcommand watch" -a "gpio:\t'two GPIO lines'
spi:\t'spidev: SCLK is MA, MISO is SLO'
wave:\t'spidev: MOSI is MA, MISO is SLO'
sim\t'simulated encoder'
file:\t'recording: sigrok session, VCD, CSV'
exec:\t'a slave in another process, such as an HDL simulator'
NAME\t'an encoder of the configuration'"
complete -c biss -n "__fish_biss_using_subcommand detect" -a "gpio:\t'two GPIO lines'
spi:\t'spidev: SCLK is MA, MISO is SLO'
wave:\t'spidev: MOSI is MA, MISO is SLO'
sim\t'simulated encoder'
file:\t'recording: sigrok session, VCD, CSV'
exec:\t'a slave in another process, such as an HDL simulator'
NAME\t'an encoder of the configuration'"
complete -c biss -n "__fish_biss_using_subcommand scope" -a "gpio:\t'two GPIO lines'
spi:\t'spidev: SCLK is MA, MISO is SLO'
wave:\t'spidev: MOSI is MA, MISO is SLO'
sim\t'simulated encoder'
file:\t'recording: sigrok session, VCD, CSV'
exec:\t'a slave in another process, such as an HDL simulator'
NAME\t'an encoder of the configuration'"
complete -c biss -n "__fish_biss_using_subcommand capture" -a "gpio:\t'two GPIO lines'
spi:\t'spidev: SCLK is MA, MISO is SLO'
wave:\t'spidev: MOSI is MA, MISO is SLO'
sim\t'simulated encoder'
file:\t'recording: sigrok session, VCD, CSV'
exec:\t'a slave in another process, such as an HDL simulator'
NAME\t'an encoder of the configuration'"
complete -c biss -n "__fish_biss_using_subcommand reg; and not __fish_seen_subcommand_from read write dump save load" -a "gpio:\t'two GPIO lines'
wave:\t'spidev: MOSI is MA, MISO is SLO'
sim\t'simulated encoder'
exec:\t'a slave in another process, such as an HDL simulator'"
complete -c biss -n "__fish_biss_using_subcommand command" -a "gpio:\t'two GPIO lines'
wave:\t'spidev: MOSI is MA, MISO is SLO'
sim\t'simulated encoder'
exec:\t'a slave in another process, such as an HDL simulator'"
complete -c biss -n "__fish_biss_using_subcommand info" -a "gpio:\t'two GPIO lines'
wave:\t'spidev: MOSI is MA, MISO is SLO'
sim\t'simulated encoder'
exec:\t'a slave in another process, such as an HDL simulator'"
complete -c biss -n "__fish_biss_using_subcommand loopback" -a "sim\t'in process: every link’s way to clock, against the simulated slave'
gpio:\t'jumpers from MA to ma-in and from slo-out to SLO'
wave:\t'a jumper from MOSI to MISO: every bit must come back'"
