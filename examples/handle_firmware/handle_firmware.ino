// A haptography handle on a Teensy 4 with a current amplifier: docs/reference/handle-protocol.md, version 2, over the
// USB serial port (Tools > USB Type: Serial). Tested on a computer against the simulated handle, byte by byte; not run
// on a board yet. Before you hold it, check the force on a scale, and the watchdog by pulling the cable.
//
// For each sample, a timer interrupt takes one force from the buffer, outputs it, and reads the accelerometer. The main
// loop reads and writes lines.

#include <Arduino.h>

// Change these for your handle.
const uint32_t RATE_HZ = 5000;
const long LIMIT = 30000;       // maximum force [1e-4 N]
const long FULL_SCALE = 40000;  // force at the end of the amplifier's input range [1e-4 N]
const long READING = 48;        // acceleration of one count of the converter [1e-3 m/s2]
const int PIN_FORCE = 3;        // PWM through a low-pass filter: half duty is zero current
const int PIN_ENABLE = 4;       // enables the amplifier: prevents a force while the board starts
const int PIN_ACCELERATION = A0;
const char HEADER[] =  // its scales match the constants above
    "#hapscene-probe 1 rate=5000 columns=force:N:0.0001,acceleration:m/s2:0.001,played:1:1.0,state:1:1.0";

const uint32_t BUFFER = 1024;  // force samples, required by the protocol
const uint32_t ROWS = 512;     // samples that wait for the computer
const long LINE_COUNT = 32;
const size_t LINE_MAX_LENGTH = 300;
const long LIVE = 1, EMPTY = 2, STOPPED = 4, LIMITED = 8, RUN = 16;

struct Row {
  uint32_t number;
  long force, reading, played, state;
};

long force_buffer[BUFFER];
uint32_t force_first = 0, waiting = 0;
uint32_t expected = 0, played = 0, quiet = 0, watchdog = 0;  // watchdog [samples]; 0 disables it, for a sweep
long run = 0;
bool stopped = false, announce = true;
Row rows[ROWS];
volatile uint32_t rows_made = 0, rows_sent = 0;
uint32_t number = 0;
char line[LINE_MAX_LENGTH];
size_t line_length = 0;
IntervalTimer timer;

void put_out(long force) {
  analogWrite(PIN_FORCE, 2048 + force * 2047 / FULL_SCALE);
}

// Process one sample, in the timer interrupt.
void tick() {
  if (watchdog > 0 && quiet >= watchdog) {
    stopped = true;
    waiting = 0;
  }
  ++quiet;
  const bool empty = waiting == 0;
  long command = 0;
  if (!empty) {
    command = force_buffer[force_first];
    force_first = (force_first + 1) % BUFFER;
    --waiting;
    played = (played + 1) & 0xFFFF;
  }
  const long force = command > LIMIT ? LIMIT : command < -LIMIT ? -LIMIT : command;
  put_out(force);
  digitalWrite(PIN_ENABLE, stopped ? LOW : HIGH);
  const long reading = (analogRead(PIN_ACCELERATION) - 2048) * READING;
  const long state = RUN * run + (watchdog ? LIVE : 0) + (empty ? EMPTY : 0) + (stopped ? STOPPED : 0) +
                     (force != command ? LIMITED : 0);
  if (rows_made - rows_sent < ROWS) rows[rows_made++ % ROWS] = {number, force, reading, (long)played, state};
  ++number;
}

// CRC-16/CCITT-FALSE.
uint16_t checksum(const char *text, size_t length) {
  uint16_t crc = 0xFFFF;
  for (size_t i = 0; i < length; ++i) {
    crc ^= (uint16_t)((uint8_t)text[i] << 8);
    for (int bit = 0; bit < 8; ++bit) crc = crc & 0x8000 ? (crc << 1) ^ 0x1021 : crc << 1;
  }
  return crc;
}

void send(char *text, int length) {
  length += snprintf(text + length, 8, "*%04X\n", checksum(text, length));
  Serial.write(text, length);
}

// Read an integer in its canonical form with at most this many digits, and advance `at`.
bool read_number(const char *&at, const char *end, int digits, bool sign, long &value) {
  const bool negative = sign && at < end && *at == '-';
  if (negative) ++at;
  const char *first = at;
  value = 0;
  while (at < end && *at >= '0' && *at <= '9' && at - first < digits) value = 10 * value + (*at++ - '0');
  if (at == first || (*first == '0' && (at - first > 1 || negative))) return false;
  if (negative) value = -value;
  return true;
}

bool read_text(const char *&at, const char *end, const char *text) {
  const size_t length = strlen(text);
  if ((size_t)(end - at) < length || memcmp(at, text, length) != 0) return false;
  at += length;
  return true;
}

void begin_run(uint32_t watchdog_samples, long run_number) {
  noInterrupts();
  waiting = expected = played = quiet = 0;
  watchdog = watchdog_samples;
  run = run_number;
  stopped = false;
  announce = true;
  interrupts();
}

void fill(uint32_t first, const long *counts, uint32_t count) {
  noInterrupts();
  uint32_t lost = (first - expected) & 0xFFFF;
  const bool fits = waiting + lost + count <= BUFFER;
  if (!watchdog && lost > BUFFER) lost = 0;
  if (!watchdog || (first <= 0xFFFF && !stopped && fits)) {
    for (uint32_t i = 0; i < lost + count && waiting < BUFFER; ++i)
      force_buffer[(force_first + waiting++) % BUFFER] = i < lost ? 0 : counts[i - lost];
    expected = (first + count) & 0xFFFF;
    quiet = 0;
  }
  interrupts();
}

// Process one line without its end. A line that does not follow the protocol exactly is ignored.
void take_line() {
  if (line_length < 5 || line_length >= LINE_MAX_LENGTH || line[line_length - 5] != '*') return;
  const char *at = line, *end = line + line_length - 5;
  char crc[5];
  snprintf(crc, sizeof crc, "%04X", checksum(line, end - line));
  if (memcmp(end + 1, crc, 4) != 0) return;
  long value, run_number, counts[LINE_COUNT];
  if (read_text(at, end, "#hapscene-handle 1 start") && at == end) return begin_run(0, 0);
  at = line;
  if (read_text(at, end, "#hapscene-handle 2 start watchdog=")) {
    if (read_number(at, end, 4, false, value) && read_text(at, end, " run=") &&
        read_number(at, end, 3, false, run_number) && at == end && value >= 5 && value <= 1000 && run_number >= 1 &&
        run_number <= 255)
      begin_run(value * RATE_HZ / 1000, run_number);
    return;
  }
  if (!read_number(at, end, 5, false, value)) return;
  uint32_t count = 0;
  while (at < end && count < (uint32_t)LINE_COUNT) {
    if (*at++ != ',' || !read_number(at, end, 7, true, counts[count++])) return;
  }
  if (at == end && count > 0) fill(value, counts, count);
}

void setup() {
  pinMode(PIN_ENABLE, OUTPUT);
  digitalWrite(PIN_ENABLE, LOW);
  analogWriteResolution(12);
  analogWriteFrequency(PIN_FORCE, 36621);
  analogReadResolution(12);
  put_out(0);
  Serial.begin(0);
  timer.begin(tick, 1000000 / RATE_HZ);
}

void loop() {
  while (Serial.available() > 0) {
    const int byte = Serial.read();
    if (byte == '\n') {
      take_line();
      line_length = 0;
    } else if (line_length < LINE_MAX_LENGTH) {
      line[line_length++] = (char)byte;  // a line that is too long is ignored
    }
  }
  while (rows_sent != rows_made && Serial.availableForWrite() > 200) {
    const Row row = rows[rows_sent % ROWS];
    char text[160];
    if (announce || row.number % 1000 == 0) {
      announce = false;
      send(text, snprintf(text, sizeof text - 8, "%s", HEADER));
    }
    send(text, snprintf(text, sizeof text - 8, "%lu,%ld,%ld,%ld,%ld", (unsigned long)(row.number & 0xFFFF), row.force,
                        row.reading, row.played, row.state));
    ++rows_sent;
  }
}
