// SPDX-License-Identifier: GPL-2.0
/*
 * Test lab only. A GPIO chip and a bit-banged SPI bus whose pins end in a
 * user-space peer, so that the kernel's own GPIO character device and spidev
 * can be tried on a machine that has neither.
 *
 * Every level change that a driver makes on an output pin is an event which
 * the peer reads from /dev/biss-wire, and the driver's call does not return
 * before the peer asks for the next event. So a slave model in user space
 * keeps up with a master at any clock, however slow or loaded the machine is.
 *
 *   read  -> struct wire_event { u64 at_ns; u32 line; u32 level; }
 *            an edge, or WIRE_TIMER | line: the timer ran out, and this is
 *            what that line shows now. All times are CLOCK_MONOTONIC.
 *   write <- struct wire_order { u64 at_ns; u32 line; u32 level; }, one or
 *            more: the input `line` shows `level` from at_ns on (0: at once;
 *            a later order for a line takes the place of one still ahead),
 *            or WIRE_TIMER | line: start the only timer,
 *            or WIRE_WATCH | line: edges of this line are events, and of
 *            lines that nobody has said this of no longer. So a clock that
 *            means nothing to the peer runs on without it.
 *
 * An order ahead of its time needs nobody to be awake when the time comes:
 * the pin shows it to whoever looks then.
 *
 * Without a peer it is a plain chip, and inputs stay as they were. What a
 * board does beside the encoder is in parameters, which can be written while
 * it runs: jumpers between pins, pulls, and what becomes of a released line.
 */
#include <linux/gpio/driver.h>
#include <linux/hrtimer.h>
#include <linux/ktime.h>
#include <linux/miscdevice.h>
#include <linux/module.h>
#include <linux/pinctrl/pinconf-generic.h>
#include <linux/platform_device.h>
#include <linux/sched/signal.h>
#include <linux/spi/spi.h>
#include <linux/uaccess.h>
#include <linux/wait.h>

#define WIRE_MAX 64
#define WIRE_TIMER 0x80000000u
#define WIRE_WATCH 0x40000000u
/* the SPI bus has pins of its own, after the GPIO chip's */
enum { PIN_SCK = 60, PIN_MOSI, PIN_MISO, PIN_CS };

static char *label = "pinctrl-bcm2711";
module_param(label, charp, 0444);
static int lines = 58;
module_param(lines, int, 0444);
static int bus;
module_param(bus, int, 0444);
static int peer_ms = 1000;
module_param(peer_ms, int, 0644);
MODULE_PARM_DESC(peer_ms, "longest wait for the peer, ms; after it the peer counts as gone for that edge");
static unsigned int late;
module_param(late, uint, 0444);
MODULE_PARM_DESC(late, "edges that did not wait for the peer any longer (read only)");

struct wire_event { u64 at_ns; u32 line; u32 level; };
struct wire_order { u64 at_ns; u32 line; u32 level; };

static DEFINE_MUTEX(drive_mutex);	/* one edge at a time */
static DEFINE_SPINLOCK(wire_lock);	/* everything below */
static DECLARE_WAIT_QUEUE_HEAD(wire_wq);

static u64 jumpers[WIRE_MAX];		/* by output: the inputs that show its level */
static u64 pulled_up;			/* lines whose pull-up is on */
static u64 watched;			/* lines whose edges are events; none: all are */
static struct wire_event edge;		/* the edge that waits for the peer */
static bool is_open, pending, taken;	/* ...if there is one; the peer has read it */
static u64 timer_ns = U64_MAX;
static u32 timer_line;
static struct {
	u64 at_ns;			/* when an input takes its next level; 0: none ahead */
	u64 driven_ns;			/* when the last call that drove it was over */
	u8 level, next, out;
} pin[WIRE_MAX];

/* the level a pin shows now; under wire_lock */
static u8 pin_level(unsigned int line)
{
	if (pin[line].at_ns && ktime_get_ns() >= pin[line].at_ns) {
		pin[line].level = pin[line].next;
		pin[line].at_ns = 0;
	}
	return pin[line].level;
}

/* a pin has a new level, and so have the inputs it is jumpered to; under wire_lock */
static void pin_show(unsigned int line, u8 level)
{
	unsigned int to;

	pin[line].level = level;
	for (to = 0; to < WIRE_MAX; to++) {
		if (jumpers[line] >> to & 1 && !pin[to].out) {
			pin[to].level = level;
			pin[to].at_ns = 0;
		}
	}
}

static int wire_sense(unsigned int line)
{
	int level;

	spin_lock(&wire_lock);
	level = pin_level(line);
	spin_unlock(&wire_lock);
	return level;
}

static void wire_drive(unsigned int line, bool level)
{
	mutex_lock(&drive_mutex);
	spin_lock(&wire_lock);
	if (pin_level(line) == level || !is_open || (watched && !(watched >> line & 1))) {
		pin_show(line, level);
		pin[line].driven_ns = ktime_get_ns();
		spin_unlock(&wire_lock);
		mutex_unlock(&drive_mutex);
		return;
	}
	pin_show(line, level);
	edge = (struct wire_event){ ktime_get_ns(), line, level };
	pending = true;
	taken = false;
	spin_unlock(&wire_lock);
	wake_up_all(&wire_wq);
	/* uninterruptible: a signal to the master must not bend the wire */
	if (!wait_event_timeout(wire_wq, !READ_ONCE(pending), msecs_to_jiffies(peer_ms))) {
		spin_lock(&wire_lock);
		if (pending)
			late++;
		pending = false;
		spin_unlock(&wire_lock);
	}
	spin_lock(&wire_lock);
	pin[line].driven_ns = ktime_get_ns();
	spin_unlock(&wire_lock);
	mutex_unlock(&drive_mutex);
}

/* an output drives its pin: no order ahead may change it any more */
static void wire_direction(unsigned int line, bool out)
{
	spin_lock(&wire_lock);
	pin_level(line);
	pin[line].at_ns = 0;
	pin[line].out = out;
	spin_unlock(&wire_lock);
}

/* The board's side */

static int jumper_set(const char *text, const struct kernel_param *p)
{
	u64 next[WIRE_MAX] = { 0 };
	unsigned int from, to;
	int n;

	for (; *text && *text != '\n'; text += n + (text[n] == ',')) {
		if (sscanf(text, "%u:%u%n", &from, &to, &n) != 2 || from >= WIRE_MAX || to >= WIRE_MAX)
			return -EINVAL;
		next[from] |= BIT_ULL(to);
	}
	spin_lock(&wire_lock);
	memcpy(jumpers, next, sizeof(jumpers));
	for (from = 0; from < WIRE_MAX; from++)
		if (jumpers[from])
			pin_show(from, pin_level(from));
	spin_unlock(&wire_lock);
	return 0;
}

static const struct kernel_param_ops jumper_ops = { .set = jumper_set };
module_param_cb(jumper, &jumper_ops, NULL, 0200);
MODULE_PARM_DESC(jumper, "FROM:TO[,FROM:TO...]: the input TO shows the level of the output FROM");
static bool release_low;
module_param(release_low, bool, 0644);
MODULE_PARM_DESC(release_low, "an output that is released becomes a low input, as a pull-down makes it");
static u64 high_ns;
module_param(high_ns, ullong, 0644);
MODULE_PARM_DESC(high_ns, "how long the output released last had been high since it was driven, 0 when it was low");
static char pulls = 'y';
static int pulls_set(const char *text, const struct kernel_param *p)
{
	if (*text != 'y' && *text != 'n' && *text != 'e')
		return -EINVAL;
	pulls = *text;
	return 0;
}

static const struct kernel_param_ops pulls_ops = { .set = pulls_set };
module_param_cb(pulls, &pulls_ops, NULL, 0200);
MODULE_PARM_DESC(pulls, "y: pulls can be set; n: there are none, which gpiolib hides; e: there are none, an error");
module_param(pulled_up, ullong, 0444);
MODULE_PARM_DESC(pulled_up, "lines whose pull-up is on, as bits (read only)");

/* The peer's side */

static int wire_open(struct inode *i, struct file *f)
{
	int r = 0;

	spin_lock(&wire_lock);
	if (is_open) {
		r = -EBUSY;
	} else {
		is_open = true;
		watched = 0;
		timer_ns = U64_MAX;
	}
	spin_unlock(&wire_lock);
	return r;
}

static int wire_release(struct inode *i, struct file *f)
{
	spin_lock(&wire_lock);
	is_open = false;
	pending = false;
	spin_unlock(&wire_lock);
	wake_up_all(&wire_wq);
	return 0;
}

/* something to read now? under wire_lock */
static bool wire_ready(struct wire_event *ev)
{
	u64 now;

	if (pending && !taken) {
		taken = true;
		*ev = edge;
		return true;
	}
	now = ktime_get_ns();
	if (now >= timer_ns) {
		*ev = (struct wire_event){ now, WIRE_TIMER | timer_line, pin_level(timer_line) };
		timer_ns = U64_MAX;
		return true;
	}
	return false;
}

static ssize_t wire_read(struct file *f, char __user *b, size_t n, loff_t *o)
{
	struct wire_event ev;
	bool wake = false, ready;
	u64 until;
	int r;

	if (n < sizeof(ev))
		return -EINVAL;
	spin_lock(&wire_lock);
	/* done with the edge read before, if any: let its driver go on */
	if (pending && taken) {
		pending = false;
		wake = true;
	}
	spin_unlock(&wire_lock);
	if (wake)
		wake_up_all(&wire_wq);
	for (;;) {
		spin_lock(&wire_lock);
		ready = wire_ready(&ev);
		until = timer_ns;
		spin_unlock(&wire_lock);
		if (ready)
			return copy_to_user(b, &ev, sizeof(ev)) ? -EFAULT : sizeof(ev);
		if (f->f_flags & O_NONBLOCK)
			return -EAGAIN;
		if (until == U64_MAX) {
			r = wait_event_interruptible(wire_wq, READ_ONCE(pending));
		} else {
			u64 now = ktime_get_ns();

			r = wait_event_interruptible_hrtimeout(wire_wq, READ_ONCE(pending),
				ns_to_ktime(until > now ? until - now : 1));
		}
		if (r && r != -ETIME)
			return r;
	}
}

static ssize_t wire_write(struct file *f, const char __user *b, size_t n, loff_t *o)
{
	struct wire_order in;
	size_t k;
	u32 line;

	for (k = 0; k + sizeof(in) <= n; k += sizeof(in)) {
		if (copy_from_user(&in, b + k, sizeof(in)))
			return -EFAULT;
		line = in.line & ~(WIRE_TIMER | WIRE_WATCH);
		if (line >= WIRE_MAX)
			return -EINVAL;
		spin_lock(&wire_lock);
		if (in.line & WIRE_TIMER) {
			timer_ns = in.at_ns;
			timer_line = line;
		} else if (in.line & WIRE_WATCH) {
			watched |= BIT_ULL(line);
		} else if (!pin[line].out) {
			pin_level(line);
			pin[line].next = !!in.level;
			pin[line].at_ns = in.at_ns;
			if (!in.at_ns)
				pin[line].level = pin[line].next;
		}
		spin_unlock(&wire_lock);
	}
	return k ? k : -EINVAL;
}

static const struct file_operations wire_fops = {
	.owner = THIS_MODULE, .open = wire_open, .release = wire_release,
	.read = wire_read, .write = wire_write, .llseek = noop_llseek,
};
static struct miscdevice wire_misc = {
	.minor = MISC_DYNAMIC_MINOR, .name = "biss-wire", .fops = &wire_fops,
};

/* The GPIO chip */

static int wire_dir_in(struct gpio_chip *gc, unsigned int o)
{
	wire_direction(o, false);
	return 0;
}

static int wire_dir_out(struct gpio_chip *gc, unsigned int o, int v)
{
	wire_direction(o, true);
	wire_drive(o, v);
	return 0;
}

static int wire_get_dir(struct gpio_chip *gc, unsigned int o)
{
	return READ_ONCE(pin[o].out) ? GPIO_LINE_DIRECTION_OUT : GPIO_LINE_DIRECTION_IN;
}

static int wire_get(struct gpio_chip *gc, unsigned int o)
{
	return wire_sense(o);
}

static void wire_set(struct gpio_chip *gc, unsigned int o, int v)
{
	wire_drive(o, v);
}

static int wire_config(struct gpio_chip *gc, unsigned int o, unsigned long config)
{
	enum pin_config_param what = pinconf_to_config_param(config);

	if (what != PIN_CONFIG_BIAS_PULL_UP && what != PIN_CONFIG_BIAS_PULL_DOWN && what != PIN_CONFIG_BIAS_DISABLE)
		return -ENOTSUPP;
	if (pulls != 'y')
		return pulls == 'n' ? -ENOTSUPP : -EOPNOTSUPP;
	spin_lock(&wire_lock);
	pulled_up &= ~BIT_ULL(o);
	if (what == PIN_CONFIG_BIAS_PULL_UP)
		pulled_up |= BIT_ULL(o);
	/* a pull matters where nothing drives */
	if (!is_open && !pin[o].out && what != PIN_CONFIG_BIAS_DISABLE)
		pin[o].level = what == PIN_CONFIG_BIAS_PULL_UP;
	spin_unlock(&wire_lock);
	return 0;
}

static void wire_free(struct gpio_chip *gc, unsigned int o)
{
	if (!READ_ONCE(pin[o].out))
		return;
	spin_lock(&wire_lock);
	high_ns = pin[o].level ? ktime_get_ns() - pin[o].driven_ns : 0;
	spin_unlock(&wire_lock);
	if (!release_low)
		return;
	wire_drive(o, 0);
	wire_direction(o, false);
}

static struct gpio_chip gc = {
	.owner = THIS_MODULE, .base = -1, .can_sleep = true,
	.direction_input = wire_dir_in, .direction_output = wire_dir_out,
	.get_direction = wire_get_dir, .get = wire_get, .set = wire_set,
	.set_config = wire_config, .free = wire_free,
};
static const char *names[WIRE_MAX];

/*
 * The SPI bus: modes 0 to 3, 8 bits a word, speed_hz as far as the peer lets
 * it: an edge that takes it longer makes the next bits shorter, so that those
 * behind them stand where they would, but no pause is made up for. As real
 * controllers do, it sets SCK's idle level with the first
 * message of a mode, not when the mode is set.
 */

static bool mosi_low;
module_param(mosi_low, bool, 0644);
MODULE_PARM_DESC(mosi_low, "MOSI goes low after each transfer instead of staying at its last bit");

/* what an edge may take the peer without moving all bits behind it */
#define SPI_EDGE_NS 50000

static void spi_half(u64 *due_ns, u32 hz)
{
	u64 half = 500000000ULL / (hz ?: 1), now = ktime_get_ns();

	*due_ns += half;
	if (now > *due_ns + SPI_EDGE_NS)
		*due_ns = now;
	while (ktime_get_ns() < *due_ns)
		cpu_relax();
}

static void wire_spi_cs(struct spi_device *s, bool level)
{
	wire_drive(PIN_CS, level);
}

static int wire_spi_one(struct spi_controller *c, struct spi_device *s, struct spi_transfer *t)
{
	const u8 *tx = t->tx_buf;
	u8 *rx = t->rx_buf;
	bool idle = s->mode & SPI_CPOL, late_phase = s->mode & SPI_CPHA;
	unsigned int i;
	u64 due_ns;
	int b;

	wire_drive(PIN_SCK, idle);
	due_ns = ktime_get_ns();
	for (i = 0; i < t->len; i++) {
		u8 out = tx ? tx[i] : 0, in = 0;

		for (b = 7; b >= 0; b--) {
			if (late_phase)
				wire_drive(PIN_SCK, !idle);
			wire_drive(PIN_MOSI, out >> b & 1);
			spi_half(&due_ns, t->speed_hz);
			/* sampled on the edge that follows: what stood there before it */
			in = in << 1 | wire_sense(PIN_MISO);
			wire_drive(PIN_SCK, late_phase ? idle : !idle);
			spi_half(&due_ns, t->speed_hz);
			if (!late_phase)
				wire_drive(PIN_SCK, idle);
		}
		if (rx)
			rx[i] = in;
	}
	if (mosi_low)
		wire_drive(PIN_MOSI, false);
	return 0;
}

static struct platform_device *pdev;
static struct spi_controller *ctlr;

static int __init wire_init(void)
{
	/* a name that spidev knows */
	struct spi_board_info bi = {
		.modalias = "dh2228fv", .max_speed_hz = 125000000, .mode = SPI_MODE_0,
	};
	int r, i;

	if (lines < 1 || lines > PIN_SCK)
		return -EINVAL;
	pin[PIN_SCK].out = pin[PIN_MOSI].out = pin[PIN_CS].out = 1;
	pdev = platform_device_register_simple("biss-wire", -1, NULL, 0);
	if (IS_ERR(pdev))
		return PTR_ERR(pdev);
	for (i = 0; i < lines; i++)
		names[i] = devm_kasprintf(&pdev->dev, GFP_KERNEL, "GPIO%d", i);
	gc.label = label;
	gc.ngpio = lines;
	gc.parent = &pdev->dev;
	gc.names = names;
	r = gpiochip_add_data(&gc, NULL);
	if (r)
		goto e_pdev;
	ctlr = spi_alloc_master(&pdev->dev, 0);
	if (!ctlr) {
		r = -ENOMEM;
		goto e_gpio;
	}
	ctlr->bus_num = bus;
	ctlr->num_chipselect = 1;
	ctlr->mode_bits = SPI_CPOL | SPI_CPHA | SPI_CS_HIGH | SPI_NO_CS;
	ctlr->bits_per_word_mask = SPI_BPW_MASK(8);
	ctlr->set_cs = wire_spi_cs;
	ctlr->transfer_one = wire_spi_one;
	r = spi_register_controller(ctlr);
	if (r) {
		spi_controller_put(ctlr);
		goto e_gpio;
	}
	if (!spi_new_device(ctlr, &bi)) {
		r = -ENODEV;
		goto e_spi;
	}
	r = misc_register(&wire_misc);
	if (!r)
		return 0;
e_spi:
	spi_unregister_controller(ctlr);
e_gpio:
	gpiochip_remove(&gc);
e_pdev:
	platform_device_unregister(pdev);
	return r;
}

static void __exit wire_exit(void)
{
	misc_deregister(&wire_misc);
	spi_unregister_controller(ctlr);
	gpiochip_remove(&gc);
	platform_device_unregister(pdev);
}

module_init(wire_init);
module_exit(wire_exit);
MODULE_DESCRIPTION("GPIO and SPI pins that end in a user-space peer, for tests");
MODULE_LICENSE("GPL");
