defmodule BB.Firmware.InitTest do
  use ExUnit.Case, async: true

  import ExUnit.CaptureLog

  alias BB.Firmware.Board.Memory
  alias BB.Firmware.{Init, Provisioning, Trial}

  @moduletag :tmp_dir

  # What does not hang has all the time that a busy machine needs.
  @quick [attempts: 2, pause_ms: 0, limit_ms: 30_000]
  @limit_ms %{hang: 1_000}

  # A board of which nothing can be asked: the handle says how it goes wrong.
  defmodule Wild do
    for {name, arity} <- BB.Firmware.Board.behaviour_info(:callbacks) do
      args = Macro.generate_arguments(arity - 1, __MODULE__)
      def unquote(name)(how, unquote_splicing(args)), do: wrong(how, unquote(args))
    end

    def wrong(:raise, _), do: raise("no card")
    def wrong(:throw, _), do: throw(:ball)
    def wrong(:exit, _), do: exit({:timeout, {GenServer, :call, [KV, :get, 1_000]}})
    def wrong(:nonsense, _), do: {:what, :is, "this"}
    def wrong(:hang, _), do: Process.sleep(:infinity)
  end

  for how <- [:raise, :throw, :exit, :nonsense, :hang] do
    test "a board that answers each question with #{how} does not end the start", %{
      tmp_dir: folder
    } do
      test = self()

      opts = [
        board: {Wild, unquote(how)},
        folder: folder,
        keys: folder,
        mount: fn ->
          send(test, :mounted)
          Wild.wrong(unquote(how), [])
        end,
        attempt: [attempts: 1, pause_ms: 0, limit_ms: limit_ms(unquote(how))]
      ]

      capture_log(fn ->
        assert Init.start_link(opts) == :ignore

        assert Provisioning.start_link(
                 board: {Wild, unquote(how)},
                 network: {Wild, unquote(how)},
                 limit_ms: limit_ms(unquote(how))
               ) == :ignore
      end)

      assert_received :mounted
    end
  end

  defp limit_ms(how), do: Map.get(@limit_ms, how, 30_000)

  test "what goes wrong is left out, and the rest is done", %{tmp_dir: folder} do
    file = Path.join(folder, "ssh_host_ed25519_key")
    File.write!(file, "damaged")
    {:ok, memory} = Memory.start_link(firmware: %{"nerves_fw_uuid" => "new"})
    Memory.answer(memory, :ready, {:error, :late})

    opts = [
      board: {Memory, memory},
      folder: Path.join(folder, "guard"),
      keys: folder,
      mount: fn -> exit({:timeout, {GenServer, :call, []}}) end,
      attempt: @quick
    ]

    log = capture_log(fn -> assert Init.start_link(opts) == :ignore end)
    assert log =~ "could not mount /data; the start continues without it"
    assert File.exists?(file <> ".corrupt")
    assert File.exists?(Path.join(folder, "guard/trial.txt"))
    refute Trial.on_trial_by_marker?(Path.join(folder, "guard"), {Memory, memory})
  end

  test "a mount that fails once is tried again", %{tmp_dir: folder} do
    {:ok, count} = Agent.start_link(fn -> 0 end)

    mount = fn ->
      if Agent.get_and_update(count, &{&1, &1 + 1}) == 0, do: exit(:noproc), else: :mounted
    end

    opts = [board: {BB.Firmware.Board.None, []}, folder: folder, keys: folder, mount: mount]
    capture_log(fn -> assert Init.start_link(opts ++ [attempt: @quick]) == :ignore end)
    assert Agent.get(count, & &1) == 2
  end
end
