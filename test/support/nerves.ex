defmodule BB.Test.Nerves do
  @moduledoc """
  Simulates `Nerves.Runtime`: modules of its names, with processes that behave as Nerves' do.

    * `FwupOps` is called with a timeout of a second (here: 500 ms), and its timeout exits only
      the caller
    * `KV` calls `FwupOps` at its first use, in its own process, which ends after a timeout

  The argument of `start/1` is the duration of each run of `fwup` in milliseconds: a list, whose
  last element applies to all further runs.
  """

  @doc "Makes the modules, and starts their processes under the calling test."
  def start(runs_ms) do
    for {name, body} <- modules(),
        do: {:module, ^name, _, _} = Module.create(name, body, Macro.Env.location(__ENV__))

    children = [{Nerves.Runtime.FwupOps, {self(), runs_ms}}, Nerves.Runtime.KV]
    {:ok, _} = Supervisor.start_link(children, strategy: :one_for_one, max_restarts: 3)
  end

  @doc "Removes the modules."
  def stop do
    for {name, _body} <- modules() do
      :code.purge(name)
      :code.delete(name)
    end
  end

  defp modules do
    [
      {Nerves.Runtime.FwupOps, fwup_ops()},
      {Nerves.Runtime.KV, kv()},
      {Nerves.Runtime.Heart, quote(do: def(init_complete, do: :ok))},
      {Nerves.Runtime, runtime()}
    ]
  end

  defp fwup_ops do
    quote do
      use GenServer
      def start_link(arg), do: GenServer.start_link(__MODULE__, arg, name: __MODULE__)
      def init(arg), do: {:ok, arg}

      def status, do: run("status")
      def revert(_opts), do: run("revert")
      def prevent_revert, do: run("prevent-revert")
      def run(task), do: GenServer.call(__MODULE__, task, 500)

      def handle_call(task, _from, {test, [ms | rest]}) do
        Process.sleep(ms)
        send(test, {:fwup, task})
        answer = if task == "status", do: {:ok, %{active: "b", next: "b"}}, else: :ok
        {:reply, answer, {test, if(rest == [], do: [ms], else: rest)}}
      end
    end
  end

  defp kv do
    quote do
      use GenServer

      @contents %{
        "nerves_fw_devpath" => "/dev/rootdisk0",
        "a.nerves_fw_uuid" => "old",
        "a.nerves_fw_version" => "1.0.0",
        "b.nerves_fw_uuid" => "new",
        "b.nerves_fw_version" => "2.0.0",
        "ganglion_name" => "ada",
        "ganglion_wifi_ssid" => ""
      }

      def start_link(_), do: GenServer.start_link(__MODULE__, [], name: __MODULE__)
      def init(_), do: {:ok, nil}
      def get(name), do: get_all()[name]
      def get_all, do: GenServer.call(__MODULE__, :all)

      def get_all_active do
        for {"b." <> name, value} <- get_all(), into: %{}, do: {name, value}
      end

      def handle_call(:all, _from, state) do
        # As in Nerves: a timeout is an exit, which nothing rescues.
        if state == nil, do: {:ok, _} = Nerves.Runtime.FwupOps.status()
        {:reply, @contents, :filled}
      end
    end
  end

  defp runtime do
    quote do
      def firmware_validation_status, do: :validated
      def validate_firmware, do: :ok
      def revert(opts), do: Nerves.Runtime.FwupOps.revert(opts)
      def reboot, do: :ok

      def firmware_slots do
        {:ok, slots} = Nerves.Runtime.FwupOps.status()
        slots
      end
    end
  end
end
