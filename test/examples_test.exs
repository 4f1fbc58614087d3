defmodule ExamplesTest do
  @moduledoc "Runs every script in examples/ as a user does, and checks its output."

  use ExUnit.Case, async: true

  # Lines (regular expressions) of the output, in this order; logs may be between them.
  @says %{
    "examples/own_driver.exs" => [
      ~S(soil: 21\.5 °C),
      ~S(soil: 21\.5 °C),
      ~S(soil: 21\.5 °C),
      ~S(soil is backoff: :i2c_nak),
      ~S(soil is up),
      ~S(soil: 21\.5 °C),
      ~S(restarts: [1-9]\d*)
    ],
    "examples/ring.exs" => [
      ~S(message 0: scan 0, \d+ µs old),
      ~S(message 1: scan 1, \d+ µs old),
      ~S(message 2: scan 2, \d+ µs old),
      ~S(the credit is used up),
      ~S(message 15: scan 15, after 12 lost),
      ~S(message 22: scan 22),
      ~S{no second publisher: the topic has a live publisher \(process \d+\); end it, or publish on another topic},
      ~S(published: 23, subscribers: 1)
    ],
    "examples/native_process.exs" => [
      ~S(frames of 640 × 480),
      ~S(camera is down: {:exit_status, 137}),
      ~S(frames again, with the next numbers),
      ~S(the topic is gone)
    ]
  }

  for {script, lines} <- @says do
    test "#{script} runs and prints its lines" do
      {output, status} = run(unquote(script))
      assert status == 0, output

      assert missing(unquote(lines), String.split(output, "\n")) == [],
             "not all lines stand in this order in:\n\n#{output}"
    end
  end

  test "each example is tested" do
    assert "examples/**/*.exs" |> Path.wildcard() |> Enum.sort() == Enum.sort(Map.keys(@says))
  end

  test "each example documents how to run it" do
    for script <- Map.keys(@says), do: assert(File.read!(script) =~ "#     mix run #{script}\n")
  end

  defp run(script) do
    System.cmd("mix", ["run", "--no-compile", script],
      env: [{"MIX_ENV", "test"}, {"LC_ALL", "C.UTF-8"}],
      stderr_to_stdout: true
    )
  end

  # The missing lines, from the first one on.
  defp missing([], _output), do: []

  defp missing([line | later] = lines, output) do
    case Enum.drop_while(output, &(not (&1 =~ ~r/^#{line}$/))) do
      [] -> lines
      [_found | rest] -> missing(later, rest)
    end
  end
end
