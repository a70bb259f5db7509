// As much of Arduino's API as the sketch needs, on a computer: what stdin says happens, what it sends goes to stdout.
//   F hex    bytes come from the host        S count    so many samples pass
#pragma once
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <string>

enum { LOW, HIGH, OUTPUT, A0 = 14 };

struct SerialPort {
  std::deque<int> come;
  void begin(long) {}
  int available() { return (int)come.size(); }
  int read() { int byte = come.front(); come.pop_front(); return byte; }
  int availableForWrite() { return 1024; }
  void write(const char *text, int length) { fwrite(text, 1, length, stdout); }
} Serial;

struct IntervalTimer {
  void (*function)() = nullptr;
  void begin(void (*f)(), long) { function = f; }
};

int samples = 0, last_output = 0;
inline int analogRead(int) { return 2048 + (samples++ * 37) % 101 - 50; }
inline void analogWrite(int, int value) {
  if (value < 0 || value > 4095) abort();
  last_output = value;
}
inline void analogWriteResolution(int) {}
inline void analogReadResolution(int) {}
inline void analogWriteFrequency(int, float) {}
inline void pinMode(int, int) {}
inline void digitalWrite(int, int) {}
inline void noInterrupts() {}
inline void interrupts() {}

void setup();
void loop();
extern IntervalTimer timer;

int main() {
  setup();
  static char text[1 << 20];
  while (fgets(text, sizeof text, stdin)) {
    if (text[0] == 'F') {
      for (char *at = text + 2; at[0] > ' ' && at[1] > ' '; at += 2)
        Serial.come.push_back((int)std::stoul(std::string(at, 2), nullptr, 16));
      loop();
    } else {
      for (int i = atoi(text + 2); i > 0; --i) {
        timer.function();
        loop();
      }
    }
  }
}
