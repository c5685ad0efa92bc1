// SPDX-License-Identifier: MIT
// The loop of an engine with snow in it, at 60 frames a second:
//     engine [--frames N] [--cell SIZE] [--as-fast-as-possible] [--save FILE]
// What a player would do stands in play(): pause, save, load. Ctrl+C ends the loop after a frame, and saves.
#include "snow.hpp"

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <string>
#include <thread>
#include <vector>

namespace
{

using engine::Vec3;

std::sig_atomic_t volatile stop = 0;
extern "C" void on_interrupt(int) { stop = 1; }

struct Options
{
    int frames = 60;
    float cell = 0.1f; ///< [m]
    bool waits = true; ///< for the time of the next frame
    std::string save = "engine.snow";
};

Options options_of(int count, char** arguments)
{
    Options options;
    for (int i = 1; i < count; ++i) {
        bool const has_value = i + 1 < count;
        if (std::strcmp(arguments[i], "--as-fast-as-possible") == 0)
            options.waits = false;
        else if (std::strcmp(arguments[i], "--frames") == 0 && has_value)
            options.frames = std::atoi(arguments[++i]);
        else if (std::strcmp(arguments[i], "--cell") == 0 && has_value)
            options.cell = float(std::atof(arguments[++i]));
        else if (std::strcmp(arguments[i], "--save") == 0 && has_value)
            options.save = arguments[++i];
        else {
            std::fprintf(stderr, "engine [--frames N] [--cell SIZE] [--as-fast-as-possible] [--save FILE]\n");
            std::exit(2);
        }
    }
    return options;
}

/// What can be compared of the snow.
std::vector<float> state_of(engine::Snow const& snow)
{
    std::vector<float> numbers{float(snow.time())};
    for (auto const& [x, y, z] : snow.positions()) numbers.insert(numbers.end(), {x, y, z});
    for (auto const& ball : snow.balls) numbers.push_back(ball.centre.x);
    return numbers;
}

/// Runs frames, each at its time by the clock.
class Loop
{
public:
    Loop(engine::Snow& snow, bool waits) : snow_(snow), waits_(waits) {}

    bool is_paused = false;

    void run(int frames)
    {
        for (; frames > 0 && stop == 0; --frames, ++count_) {
            if (waits_) std::this_thread::sleep_until(next_ += frame_time_);
            if (is_paused) continue; // the engine draws on
            auto const frame = snow_.advance(1.f / 60);
            if (count_ % 10 != 0) continue;
            float push = 0;
            for (auto const& ball : snow_.balls) push += ball.push_back.x;
            std::printf("frame %3d: %.3f s, %d steps, %zu particles, the balls are pushed by %.2f N s\n",
                        count_, snow_.time(), frame.steps, snow_.positions().size(), double(push));
        }
    }

private:
    using Clock = std::chrono::steady_clock;

    engine::Snow& snow_;
    bool waits_;
    int count_ = 0;
    Clock::time_point next_ = Clock::now();
    Clock::duration frame_time_ =
        std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / 60));
};

bool says(char const* what, bool holds)
{
    std::printf("%s: %s\n", what, holds ? "yes" : "NO");
    return holds;
}

/// Plays, pauses, saves, plays on, loads, and plays the same frames once more.
bool play(engine::Snow& snow, Loop& loop, Options const& options)
{
    std::uint32_t const snowman = 7, heap = 8;
    auto const first = snow.add_box({0, 0, 0}, {0.8f, 0.4f, 0.4f}, {0, 0, 0}, heap);
    snow.add_box({0.2f, 0.6f, 0}, {0.6f, 1, 0.4f}, {0, -2, 0}, snowman);
    for (int i = 0; i < 5; ++i)
        snow.balls.push_back({{-0.2f - 0.3f * float(i), 0.15f, 0.2f}, 0.15f, {1.5f, 0, 0}});

    bool good = true;
    int const third = options.frames / 3;
    loop.run(third);
    if (stop != 0) return good;
    auto const before = state_of(snow);
    loop.is_paused = true;
    loop.run(5);
    loop.is_paused = false;
    good &= says("a pause changes nothing", state_of(snow) == before);

    snow.save(options.save);
    loop.run(third);
    auto const after = state_of(snow);
    if (stop != 0) return good;
    good &= says("the snow goes on after the pause", after != before);
    snow.load(options.save);
    good &= says("what was saved is loaded", state_of(snow) == before);
    loop.run(third);
    if (stop != 0) return good;
    if (!options.waits) // else the number of steps in a frame is the clock's
        good &= says("after a load all goes on bit by bit as before", state_of(snow) == after);

    snow.remove(heap);
    bool all_are_snowmans = !snow.owners().empty();
    for (auto const owner : snow.owners()) all_are_snowmans = all_are_snowmans && owner == snowman;
    good &= says("what is left belongs to the snowman", all_are_snowmans);
    try {
        (void)snow.index_of(first);
        good &= says("a particle that is gone is refused", false);
    }
    catch (std::exception const& error) {
        std::printf("refused: %s\n", error.what());
    }
    loop.run(1);
    return good;
}

} // namespace

int main(int count, char** arguments)
try {
    auto const options = options_of(count, arguments);
    std::signal(SIGINT, on_interrupt);
    engine::Limits limits;
    if (!options.waits) limits = {.seconds = 1e9, .steps = 20};
    engine::Snow snow(options.cell, limits, &stop);
    Loop loop(snow, options.waits);
    bool const good = play(snow, loop, options);
    if (stop != 0) {
        snow.save(options.save);
        std::printf("interrupted, and saved in %s\n", options.save.c_str());
    }
    std::printf("done at %.3f s\n", snow.time());
    return good ? 0 : 1;
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}
